"""A campaign on a SLURM cluster: `python slurm.py SPEC.toml DIR`, from a login node.

It asks the queue for workers through dask-jobqueue, flies what DIR does not hold yet, and gives the
workers back. What stands in capitals is the cluster's own: adapt it. docs/cluster.md says more.
"""

import subprocess
import sys

from dask_jobqueue import SLURMCluster

JOBS = 8
"""Of workers; each is queued by itself, and the campaign begins with the first."""
CORES = 32
"""Of a job."""
MEMORY = "32GB"
"""Of a job; a worker needs some hundred MB."""
HOURS = 4
"""That the queue gives a job; who is still flying ten minutes before is sent home."""
QUEUE = "compute"
ACCOUNT = "spacecraft"
INTERFACE = "ib0"
"""Of the network that login and compute nodes share, as `ip address` names it."""
LOCAL = "/tmp"
"""A disk of the compute node."""


def main(words: list[str]) -> int:
    """Fly; the exit code of `twin campaign`."""
    settings = {
        "queue": QUEUE,
        "account": ACCOUNT,
        "cores": CORES,
        "processes": CORES,  # a worker has one thread
        "memory": MEMORY,
        "walltime": f"{HOURS:02d}:00:00",
        "interface": INTERFACE,
        "local_directory": LOCAL,
        "log_directory": "slurm_logs",
        "job_script_prologue": ["export OPENBLAS_NUM_THREADS=1"],
        "worker_extra_args": ["--lifetime", f"{60 * HOURS - 10}m", "--lifetime-stagger", "5m"],
    }
    with SLURMCluster(**settings) as cluster:
        print(cluster.job_script(), file=sys.stderr)
        cluster.adapt(minimum_jobs=JOBS, maximum_jobs=JOBS)  # a job that ends is followed by one
        command = ["campaign", *words, "--resume", "--cluster", cluster.scheduler_address]
        return subprocess.run([sys.executable, "-m", "twin", *command]).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
