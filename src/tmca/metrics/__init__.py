"""One definition of every figure of merit."""
