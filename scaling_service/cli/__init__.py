"""The command line: what people type, what they see, and nothing that computes."""

from scaling_service.cli.app import main

__all__ = ["main"]
