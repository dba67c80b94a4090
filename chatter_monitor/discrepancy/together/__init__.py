"""Several recordings of one machine: what they share, and one answer."""
