"""Lifted atoms of a source, their dual polynomial, and sparse measures made of them."""
