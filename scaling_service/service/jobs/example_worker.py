"""Writes an example in a process of its own; its arguments are a folder, the subject's name and a seed."""

from __future__ import annotations

import sys
from pathlib import Path

from scaling_service.core.threads import use_one_thread

if __name__ == "__main__":
    use_one_thread()  # before numpy is imported
    from scaling_service.virtual.example import write_example

    write_example(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
