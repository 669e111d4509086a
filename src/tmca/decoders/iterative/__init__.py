"""Decoders that iterate on the operator of the whole frame."""
