"""Benches: drivers, captures, snapshots of them."""
