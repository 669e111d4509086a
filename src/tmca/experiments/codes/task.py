"""`tmca.evaluation.designs` by its old name."""

from tmca.evaluation.designs import Task as Task
from tmca.evaluation.designs import camera_arguments as camera_arguments
from tmca.evaluation.designs import load_examples as load_examples
from tmca.evaluation.designs import mean as mean
from tmca.evaluation.designs import on_frame as on_frame
from tmca.evaluation.designs import save_examples as save_examples
