"""`tmca.evaluation.tables` by its old name."""

from tmca.evaluation.tables import DEPTH_METRICS as DEPTH_METRICS
from tmca.evaluation.tables import METRICS as METRICS
from tmca.evaluation.tables import check_counts as check_counts
from tmca.evaluation.tables import check_decoders as check_decoders
from tmca.evaluation.tables import check_new as check_new
from tmca.evaluation.tables import markdown_table as markdown_table
from tmca.evaluation.tables import mean_over_scenes as mean_over_scenes
from tmca.evaluation.tables import repository_commit as repository_commit
from tmca.evaluation.tables import write_table as write_table
