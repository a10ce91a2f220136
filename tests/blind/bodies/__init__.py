"""The persons of the bank."""

from tests.blind.bodies.lower_limb import lower_limb
from tests.blind.bodies.person import Person, person
from tests.blind.bodies.whole_body import whole_body

__all__ = ["Person", "lower_limb", "person", "whole_body"]
