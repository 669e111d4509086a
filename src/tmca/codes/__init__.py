"""What the aperture and the shutter show in each time slot."""
