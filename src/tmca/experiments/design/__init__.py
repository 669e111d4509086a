"""What `tmca design` does: codes and masks for a sensor, with a page about them."""
