"""Pictures of arrays: cubes, light fields, depth maps, codes, priors, trainings, measurements; they know no camera."""
