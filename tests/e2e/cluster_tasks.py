"""A run of acut-cluster whose tasks the test runs itself, phase by phase, where and as often as it wants. Used by tests/cluster and
tests/vm."""
import os
import subprocess

from e2e import expect, run

CLUSTER = os.environ.get("ACUT_CLUSTER", "acut-cluster")
TASK = os.environ.get("ACUT_TASK_PROGRAM", "acut-task")


def stl_triangles(path):
    """Of a binary STL: its head, and its triangles in an order that does not depend on the run: each from its least corner on."""
    with open(path, "rb") as f:
        data = f.read()
    triangles = []
    for i in range(96, len(data), 50):
        a, b, c = data[i:i + 12], data[i + 12:i + 24], data[i + 24:i + 36]
        triangles.append(a + b + c if a <= b and a <= c else b + c + a if b <= c else c + a + b)
    triangles.sort()
    return data[:84], triangles


class Tasks:
    """`words`: of acut-cluster mesh, without the work folder and the scheduler. `work`: the folder; where tasks see it by other
    paths, one for each node."""

    def __init__(self, words, work, script, env=None):
        self.work, self.env = [work] if isinstance(work, str) else work, dict(os.environ, **env or {})
        run([CLUSTER, "mesh", *words, "--work", self.work[0], "--on", "script", "--script", script], env=env).ok()
        with open(self.work[0] + "/acut-work") as f:
            rows = [line.split() for line in f if line.startswith("tasks ")]
        self.tasks = [(row[2], i) for row in rows for i in range(int(row[1]))]

    def start(self, phase, index, node=0, prefix=()):
        return subprocess.Popen([*prefix, TASK, self.work[node % len(self.work)], phase, str(index)], stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=self.env)

    @staticmethod
    def end(process, timeout=600):
        """Its status and what it printed."""
        text = process.communicate(timeout=timeout)[0].decode(errors="replace")
        return process.returncode, text

    def task(self, phase, index, node=0):
        status, text = self.end(self.start(phase, index, node))
        expect(status == 0, "%s %d ended with %d: %s" % (phase, index, status, text))

    def done(self, phase, index):
        return os.path.exists("%s/done/%s-%d" % (self.work[0], phase, index))

    def digests(self):
        """Of the mesh, as acut-cluster show prints them."""
        got = run([CLUSTER, "show", self.work[0], "--json"]).ok().json()["result"]
        return got["digest"], got["vertex_digest"]

    def named(self):
        """The files that records name."""
        names = set()
        for phase, i in self.tasks:
            with open("%s/done/%s-%d" % (self.work[0], phase, i)) as f:
                names |= {line.rstrip("\n").split(" ", 2)[2] for line in f if line.startswith("file ")}
        return names

    def unnamed(self):
        """Files of tasks that no record names: of attempts that left something."""
        there = set()
        for top, _, files in os.walk(self.work[0]):
            there |= {os.path.relpath(os.path.join(top, f), self.work[0]) for f in files}
        known = self.named() | {"acut-work", "inputs", "dataset/manifest"} | {"done/%s-%d" % task for task in self.tasks}
        # The dataset's folder has second names of the segments.
        bases = {os.path.basename(name) for name in known}
        # shared-0-RUN says which outputs all tasks write.
        return sorted(name for name in there - known if name.split("/")[0] not in ("log", "failed") and not name.startswith("shared-0-") and
                      not (name.startswith("dataset/") and os.path.basename(name) in bases))

    def clean(self):
        run([CLUSTER, "clean", self.work[0]]).ok()
        expect(not os.path.exists(self.work[0]), "clean has left something")
