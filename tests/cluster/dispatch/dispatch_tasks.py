"""Shared by local.py, slurm.py and fake.py: work folders whose tasks run a line of shell, and dispatch-run over them."""
import os
import subprocess

RUN = os.environ["DISPATCH_RUN"]


class Tasks:
    """Tasks run `body` with $w, $p and $i, then are done. The folder "bin" is the first of PATH."""
    name = "it's a task"

    def __init__(self, path, scheduler, id, body, poll, env=None):
        self.path, self.scheduler, self.id, self.poll = path, scheduler, id, poll
        self.env = {**os.environ, "PATH": path + "/bin:" + os.environ["PATH"], **(env or {})}
        for folder in ("log", "done", "bin"):
            os.makedirs(os.path.join(path, folder))
        self.task = os.path.join(path, self.name)
        with open(self.task, "w") as f:
            f.write('#!/bin/bash\nw=$1 p=$2 i=$3\n%s\n: >"$w/done/$p-$i"\n' % body)
        os.chmod(self.task, 0o755)

    def start(self, command, *phases, scheduler=None, **env):
        return subprocess.Popen([RUN, scheduler or self.scheduler, self.path, self.id, self.task, self.poll, command, *phases],
                                env={**self.env, **env}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def run(self, command, *phases, **kw):
        """Its status and what it printed."""
        p = self.start(command, *phases, **kw)
        out = p.communicate(timeout=150)[0]
        return p.returncode, out

    def done(self):
        return sorted(os.listdir(os.path.join(self.path, "done")))

    def log(self, name):
        with open(os.path.join(self.path, "log", name)) as f:
            return f.read()

    def logs(self):
        return "".join(map(self.log, sorted(os.listdir(os.path.join(self.path, "log")))))
