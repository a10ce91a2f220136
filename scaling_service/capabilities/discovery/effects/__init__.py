"""What can be missing: each effect says where it could sit and what it would look like there.

A file holds ``EFFECTS``, a tuple of
:class:`~scaling_service.capabilities.discovery.effects.catalogue.Effect`. A new file is a new effect: the
catalogue finds it, here and in other distributions that name a module or an effect under the entry point
group ``scaling_service.effects``.
"""

from __future__ import annotations
