"""Effects that act in a part of a recording only: in a stretch, or above an amplitude; and models that have them."""
