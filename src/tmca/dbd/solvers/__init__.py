"""Sliding Frank–Wolfe, the dual semidefinite programme, and certificates."""
