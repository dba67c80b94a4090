"""The figures of Nicolescu and Archenti (2013), made again with this package: ``python -m docs.paper``."""
