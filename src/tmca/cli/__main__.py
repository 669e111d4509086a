"""``python -m tmca.cli``."""

from tmca.cli import main

main()
