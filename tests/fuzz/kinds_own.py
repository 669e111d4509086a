"""Our own files: snapshots, codes, priors, weights, estimates."""
