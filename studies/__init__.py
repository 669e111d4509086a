"""The thesis' studies and our findings, on the public names of ``tmca``; they write ``docs/results``.

They are part of the repository, not of the wheel: ``tmca design study``, ``dbd study``, ``dbd report``, ``real report``
and ``calibrate proof`` find them beside a checkout that is installed with ``pip install -e .``.
"""
