"""What devices show: descriptions, placements, exports."""
