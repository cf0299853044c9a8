"""Records a long campaign on the fake bench as fast as it can, to be killed: python recording_process.py FOLDER."""

import sys
from pathlib import Path

from fake_bench import fake_bench, plan, run

if __name__ == "__main__":
    run(fake_bench(), Path(sys.argv[1]), plan(40))
