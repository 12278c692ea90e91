"""Jobs by the nodes of a Ray cluster that starts and ends here: the same outcomes as a pool's, also when nodes go."""

import os
from pathlib import Path

import pytest

from datasets.jobs import JobError, Limits, Pool, RayNodes
from tests.jobs import work
from tests.jobs.test_map import _all_gone, _by_number

ray = pytest.importorskip("ray", reason="the extra `ray` is not installed")
pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]  # a cluster takes minutes to come up on two busy cores
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def cluster():
    """Two nodes of this machine, with a processor each."""
    from ray.cluster_utils import Cluster

    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(ROOT)  # where the nodes find the project, as if it were installed there
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        nodes.add_node(num_cpus=1)
        nodes.wait_for_nodes()
        yield nodes
    finally:
        nodes.shutdown()
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before


def test_the_outcomes_are_those_of_a_pool(cluster, tmp_path):
    fates = {1: "once", 3: "always", 4: "raises"}
    told = []
    for backend, folder in ((RayNodes(cluster.address), "ray"), (Pool(2), "pool")):
        (tmp_path / folder).mkdir()
        jobs = [{"number": n, "marks": str(tmp_path / folder), "fate": fates.get(n)} for n in range(6)]
        told.append(_by_number(backend.map(work.unlucky, jobs)))
    assert told[0] == told[1]
    assert not ray.is_initialized()


def test_both_nodes_work_and_nothing_stays(cluster):
    pids = [o.value for o in RayNodes(cluster.address).map(work.process, range(10))]
    assert len(set(pids)) == 2
    assert _all_gone(pids)


def test_a_node_that_goes_takes_no_job_with_it(cluster, tmp_path):
    node = cluster.add_node(num_cpus=2)
    cluster.wait_for_nodes()
    jobs = [{"number": n, "marks": str(tmp_path), "seconds": 2.0} for n in range(6)]
    outcomes = RayNodes(cluster.address, workers=4, limits=Limits(tries=5)).map(work.slow, jobs)
    first = next(outcomes)
    cluster.remove_node(node, allow_graceful=False)
    assert [o.value for o in _by_number([first, *outcomes])] == list(range(6))


def test_no_cluster_is_said():
    with pytest.raises(JobError, match="no Ray cluster answers at"):
        list(RayNodes("127.0.0.1:1").map(work.process, [1]))
