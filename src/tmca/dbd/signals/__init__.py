"""Where samples come from: subspace bases, message models, the normalised model and the physical layer."""
