"""What stands on the optical table: devices, captures, calibration, ground truth."""
