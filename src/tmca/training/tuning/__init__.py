"""Trained decoders that go on learning from captures."""
