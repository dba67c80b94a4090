"""The one place where sources, trackers, judges and outlets are wired together."""
