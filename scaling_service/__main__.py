"""``python -m scaling_service``: the same as the command ``scaling-service``."""

from scaling_service.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
