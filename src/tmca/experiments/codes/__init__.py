"""The study of codes: when, why and by how much time multiplexing helps."""

from tmca.experiments.codes.study import study_codes

__all__ = ["study_codes"]
