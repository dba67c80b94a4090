"""Replaying archives: many recordings, in many processes, into one data set."""
