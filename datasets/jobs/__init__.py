"""Many jobs that need nothing of each other, done here, by a pool of processes, or by the machines of a Ray cluster.

    from datasets.jobs import Pool

    for outcome in Pool(workers=2).map(function, jobs):
        outcome.number, outcome.value, outcome.error

`function` is a function of a module (a worker imports it by its name), jobs and what it returns are made of what JSON
knows: numbers, texts, lists, dicts. A function returns what went wrong with a job's input; what it raises, and a worker
that dies, are accidents, after which the job is tried again. Whatever the back end and the number of workers, the
outcomes of a function that gives the same answer twice are the same; they come as they are done.
"""

from datasets.jobs.limits import Limits
from datasets.jobs.outcome import Backend, Job, JobError, Outcome, in_order
from datasets.jobs.pool import Here, Pool
from datasets.jobs.ray_nodes import RayNodes

__all__ = ["Backend", "Here", "Job", "JobError", "Limits", "Outcome", "Pool", "RayNodes", "in_order"]
