"""The catalogue: one file for each effect that can be missing.

A file holds ``KIND``, the name in results; ``MEANING``, what it is in a sentence for a person; and one of

- ``candidates(scene)``: the places where it could sit and its columns there;
- ``options(now, scene, stretch_s)``: for an effect whose course is not known beforehand, so that no column
  can stand for it: the likely ones, fitted and tried.

It may hold ``plausible(size)``, whether coefficients are so together; ``details(effect, after)``, numbers
that no column holds, with ``spreads(effect, after, stretch_s)``, their standard deviations; and, for what
swings, ``swinging(candidate, scene, frequency_hz, damping)``, the candidate at another frequency. A new file
is a new effect: ``catalogue`` finds it.
"""
