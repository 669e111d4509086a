"""Commands that are killed, stopped, run out of disk, or run twice: a fork server, and the table."""
