"""The bank needs Pinocchio, whose wheels exist for Linux and macOS only."""

from importlib.util import find_spec

if find_spec("pinocchio") is None:
    collect_ignore_glob = ["test_*.py", "osim/test_*.py"]
