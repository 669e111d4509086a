"""`tmca.evaluation.grid` by its old name."""

from tmca.evaluation.grid import CellsFailed as CellsFailed
from tmca.evaluation.grid import Failures as Failures
from tmca.evaluation.grid import Grid as Grid
from tmca.evaluation.grid import Measured as Measured
from tmca.evaluation.grid import Progress as Progress
from tmca.evaluation.grid import Settings as Settings
from tmca.evaluation.grid import Timed as Timed
from tmca.evaluation.grid import cell_key as cell_key
from tmca.evaluation.grid import run_cells as run_cells
from tmca.evaluation.grid import timed as timed
