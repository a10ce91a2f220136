"""A runner in a process of its own: ``python -m scaling_service.service.jobs [SETTINGS.yaml]``."""

from scaling_service.core.threads import use_one_thread

use_one_thread()  # before numpy is imported

import sys  # noqa: E402

from scaling_service.service.jobs.process import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
