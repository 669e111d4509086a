"""Fine-tuning a trained decoder on calibrated captures: their folder, the run, pictures, what it gains."""
