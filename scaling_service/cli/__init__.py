"""The command line: what people type, what they see, and nothing that computes."""

from scaling_service.core.threads import use_one_thread

use_one_thread()  # before anything below imports numpy

from scaling_service.cli.app import main  # noqa: E402 (see the line above)

__all__ = ["main"]
