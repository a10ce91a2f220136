"""The catalogue: one file for each effect that can be missing.

A file holds ``KIND``, the name in results; ``MEANING``, what it is in a sentence for a person; and
``candidates(scene)``, which gives the places where it could sit and its columns there. A new file is a new
effect: :mod:`scaling_service.discovery.catalogue` finds it.
"""
