"""The commands, each with its options and what it prints. What one needs is imported when it runs."""
