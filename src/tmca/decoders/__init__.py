"""From a snapshot and its codes back to the scene."""
