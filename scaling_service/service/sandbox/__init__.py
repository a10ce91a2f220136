"""Processes that parse foreign bytes: limited, without secrets, and gone with those who need them.

``supervisor`` starts a child, which Python's fork server forks from itself once it is ``warm``. The ``child``
bounds itself by ``limits`` and answers in JSON; what became of it is one of the ``outcomes``.
"""
