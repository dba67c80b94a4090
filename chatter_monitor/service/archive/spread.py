"""Jobs spread over processes of this machine or over a Dask cluster; a worker that dies takes no job with it."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.service.archive.job import Job, Outcome, work
from chatter_monitor.service.worker import Worker

# A recording that a worker died at is tried again: it may have been killed for another's memory.
ATTEMPTS = 3
CONNECT_S = 10.0
ADDRESS = re.compile(r"(tcp|tls|wss?)://\S+:\d{1,5}")


def in_processes(jobs: Sequence[Job], processes: int) -> Iterator[Outcome]:
    """Do jobs in processes of this machine; outcomes come as they are there.

    Parameters
    ----------
    jobs : sequence of Job
        What to do.
    processes : int
        How many at a time.
    """
    waiting = deque(jobs)
    attempts: Counter[str] = Counter()
    idle: list[_Worker] = []
    busy: dict[Connection, _Worker] = {}
    try:
        while waiting or busy:
            while waiting and len(busy) < processes:
                while idle and not idle[-1].alive:
                    idle.pop().stop()
                worker = idle.pop() if idle else _Worker()
                worker.begin(waiting.popleft())
                busy[worker.pipe] = worker
            ready = wait(list(busy))
            for worker in [worker for pipe, worker in busy.items() if pipe in ready]:
                del busy[worker.pipe]
                outcome: Outcome | None = worker.receive()
                if outcome is not None:
                    idle.append(worker)
                    yield outcome
                    continue
                worker.stop()
                attempts[worker.job.recording.name] += 1
                if attempts[worker.job.recording.name] < ATTEMPTS:
                    waiting.append(worker.job)
                else:
                    yield _lost(worker.job, f"{ATTEMPTS} worker processes died at it")
    finally:
        for worker in (*idle, *busy.values()):
            worker.stop()


class _Worker(Worker):
    """Does one job after the other."""

    def __init__(self) -> None:
        super().__init__(_serve)
        self.job: Job

    def begin(self, job: Job) -> None:
        self.job = job
        self.send(job)


def _serve(pipe: Connection) -> None:
    try:
        while True:
            pipe.send(work(pipe.recv()))
    except (EOFError, OSError):
        pass  # who started this is gone; what has been done stays done


def on_cluster(jobs: Sequence[Job], address: str) -> Iterator[Outcome]:
    """Do jobs on a Dask cluster; outcomes come as they are there.

    Parameters
    ----------
    jobs : sequence of Job
        What to do.
    address : str
        Of the scheduler, such as ``tcp://10.0.0.5:8786``.

    Raises
    ------
    InputError
        If the address is none.
    EnvironmentFault
        If dask.distributed is not installed, no scheduler answers, or it goes away.
    """
    try:
        from distributed import CancelledError, Client, KilledWorker, as_completed
    except ImportError as error:
        raise EnvironmentFault(
            "dask.distributed is not installed", remedy="Install it: pip install 'chatter-monitor[archive]'"
        ) from error
    if not ADDRESS.fullmatch(address):
        raise InputError("this is no address of a Dask scheduler", got=address, allowed="such as tcp://127.0.0.1:8786")
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except OSError as error:
        raise EnvironmentFault(
            "no Dask scheduler answers", got=address, remedy="Is `dask scheduler` running?"
        ) from error
    with client:
        futures = {client.submit(work, job, pure=False): job for job in jobs}
        for future in as_completed(futures, loop=client.loop):
            match problem := future.exception():
                case None:
                    yield future.result()
                case KilledWorker():
                    yield _lost(futures[future], "all workers that were given it died")
                case CancelledError():
                    raise EnvironmentFault("the Dask scheduler is gone", got=address, remedy="Start both again.")
                case _:
                    yield _lost(futures[future], f"the worker cannot do it: {type(problem).__name__}: {problem}")


def _lost(job: Job, problem: str) -> Outcome:
    fault = EnvironmentFault(problem, got=job.recording.name)
    return Outcome(job.recording.name, str(fault), fault.exit_code)
