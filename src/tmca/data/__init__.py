"""Reading and writing files, data sets, splits and rendered scenes."""
