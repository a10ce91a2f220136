"""A runner in a process of its own: ``python -m scaling_service.service.jobs [SETTINGS.yaml]``."""

from scaling_service.core.threads import use_one_thread

use_one_thread()  # before numpy is imported

if __name__ == "__main__":  # each process of a job reads this file, too, and needs nothing of the runner's
    import sys

    from scaling_service.service.jobs.process import main

    sys.exit(main(sys.argv[1:]))
