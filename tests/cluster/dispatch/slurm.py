"""Tasks on a real Slurm of three nodes: chains, replies that are lost, tasks and nodes that are killed, cancel and resume."""
import os
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from checks import asked, check, end
from dispatch_tasks import Tasks
from slurm_test import slurm


class Work(Tasks):
    """Its name has what a pattern of sbatch means something else by."""
    count = 0
    name = "task"  # Slurm does not find, and so does not measure, what a program with blanks in its name has started

    def __init__(self, base, s, body, *phases):
        Work.count += 1
        super().__init__(os.path.join(base, "work %%j %d" % Work.count), "slurm", "%04x" % Work.count, body, "0.3", s.env)
        self.s, self.phases = s, phases

    def start(self, command, **env):
        return super().start(command, *self.phases, **env)

    def names(self):
        return [n for n in (row[3] for row in self.s.queue()) if n.startswith("acut-%s-" % self.id)]


def chain(base, s):
    w = Work(base, s, 'case $p in b) [ "$(ls "$w"/done/a-* | wc -l)" = 14 ] || exit 9;; c) [ -e "$w/done/b-2" ] || exit 9;; esac',
             "a=14", "none=0", "b=3", "c=1")
    status, out = w.run("submit")
    check("submitted", status == 0, out)
    status, out = w.run("submit")
    check("and not twice", status == 0 and len(w.names()) <= 18, str(w.names()))
    s.until("the chain runs without a driver", lambda: len(w.done()) == 18)
    status, out = w.run("wait")
    check("done", status == 0 and "a 14 0 0 0" in out and "c 1 0 0 0" in out, out)
    check("each once", w.logs().count(" begins on ") == 18, w.logs())
    check("indices of an array that is one of several", "a 13 begins on" in open(w.path + "/log/a-12+1").read())


def throttle(base, s):
    w = Work(base, s, 'n=$(mktemp -p "$w" now-XXXXXX); ls "$w"/now-* | wc -l >>"$w/at"; sleep 0.5; rm "$n"', "a=5")
    status, out = w.run("wait", DISPATCH_MOST="2")
    with open(w.path + "/at") as f:
        check("at most two at once", status == 0 and max(int(n) for n in f) <= 2, out)


def lost_reply(base, s):
    """sbatch submits, and says that it could not; once that it has not submitted; and once it is refused for good."""
    # Tasks that have ended are not found by the name of their job, so these last until all has been submitted.
    w = Work(base, s, 'until [ "$(wc -l <"$w/bin/calls")" -ge 3 ]; do sleep 0.2; done', "a=2", "b=1")
    real = subprocess.run(["which", "sbatch"], capture_output=True, text=True).stdout.strip()
    with open(w.path + "/bin/sbatch", "w") as f:
        f.write('#!/bin/bash\necho x >>"$(dirname "$0")/calls"\nn=$(wc -l <"$(dirname "$0")/calls")\n[ $n = 1 ] && { %s "$@" >/dev/null || exit; }\n'
                '[ $n -le 2 ] && { echo "sbatch: error: Batch job submission failed: Socket timed out on send/recv operation" >&2; exit 1; }\n'
                'exec %s "$@"\n' % (real, real))
    os.chmod(w.path + "/bin/sbatch", 0o755)
    status, out = w.run("wait")
    check("a lost reply", status == 0 and out.count("it is looked for by its name") == 2 and w.logs().count(" begins on ") == 3, out + w.logs())
    with open(w.path + "/bin/calls") as f:
        check("submissions", len(f.read().split()) == 3, out)
    w = Work(base, s, "true", "a=1")
    status, out = w.run("submit", DISPATCH_EXTRA="--partition=none")
    check("an error of sbatch is quoted", status == 1 and "invalid partition" in out, out)


def killed(base, s):
    w = Work(base, s, 'if [ $p$i = a1 ] && mkdir "$w/first" 2>/dev/null; then kill -9 $$; fi; sleep 0.3', "a=4", "b=2", "c=1")
    status, out = w.run("wait")
    check("a killed task is submitted again, and so is what hung on it", status == 0 and len(w.done()) == 7 and
          "a 1 is submitted again: signal" in out and w.logs().count("begins") == 8, out + w.logs())
    w = Work(base, s, 'if [ $p$i = a1 ]; then echo this node has no library; exit 127; fi', "a=3", "b=1")
    status, out = w.run("wait")
    check("not for ever", status == 1 and "task a 1: failed with status 127" in out and "after 3 attempts" in out and
          "this node has no library" in out and w.logs().count("a 1 begins") == 3 and "b 0 begins" not in w.logs(), out + w.logs())
    # Without a driver nothing is submitted again, but `resume` finds what is missing.
    w = Work(base, s, 'if [ $p$i = a1 ] && mkdir "$w/first" 2>/dev/null; then kill -9 $$; fi', "a=3", "b=2")
    w.run("submit")
    s.until("the chain ends", lambda: not w.names())
    status, out = w.run("show")
    check("what is left", "a 2 0 0 1" in out and "b 0 0 0 2" in out, out)
    w.run("submit")
    s.until("the rest ends", lambda: len(w.done()) == 5)


def full(base, s):
    """A user who may have few tasks in the queue: what fits is submitted, and the rest later."""
    w = Work(base, s, "sleep 0.3", "a=7", "b=2", "c=1")
    real = subprocess.run(["which", "sbatch"], capture_output=True, text=True).stdout.strip()
    with open(w.path + "/bin/sbatch", "w") as f:
        f.write("""#!/bin/bash
for a in "$@"; do case $a in --array=*) n=$(python3 -c '
import sys
print(sum(int(r.split("-")[-1]) - int(r.split("-")[0]) + 1 for r in sys.argv[1].split("%%")[0].split(",")))' "${a#--array=}");; esac; done
[ $((n + $(squeue -h -r | wc -l))) -le 4 ] && exec %s "$@"
echo x >>"$(dirname "$0")/refused"
echo "sbatch: error: QOSMaxSubmitJobPerUserLimit" >&2
echo "sbatch: error: Batch job submission failed: Job violates accounting/QOS policy (job submit limit, user's size and/or time limits)" >&2
exit 1
""" % real)
    os.chmod(w.path + "/bin/sbatch", 0o755)
    status, out = w.run("wait")
    check("a queue with little room", status == 0 and w.logs().count(" begins on ") == 10 and
          os.path.getsize(w.path + "/bin/refused") > 0, out + w.logs())


def memory(base, s):
    w = Work(base, s, 'if mkdir "$w/first" 2>/dev/null; then python3 -c "import time; x = bytearray(300 << 20); time.sleep(30)"; exit 1; fi', "a=1")
    status, out = w.run("wait")
    check("over its memory", status == 0 and "a 0 is submitted again" in out, out + w.logs())


def node_lost(base, s):
    w = Work(base, s, 'echo $SLURMD_NODENAME >"$w/on-$i"; while [ ! -e "$w/go" ]; do sleep 0.1; done', "a=6", "b=1")
    p = w.start("wait")
    s.until("tasks run", lambda: [open(os.path.join(w.path, n)).read() for n in os.listdir(w.path) if n.startswith("on-")].count("n2\n") == 2)
    s.lose("n2")
    open(w.path + "/go", "w").close()
    out = p.communicate(timeout=200)[0]
    check("a node is lost", p.returncode == 0 and len(w.done()) == 7, out + w.logs())
    again = w.logs().count("begins") - 7
    check("its tasks ran again", 1 <= again <= 2 and "start 1" in w.logs(), w.logs())
    s.do("back", "n2")
    s.until("the node comes back", lambda: s.run("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == "3")


def cancelled(base, s):
    w = Work(base, s, 'while [ ! -e "$w/go" ]; do sleep 0.2; done', "a=8", "b=1")
    w.run("submit")
    s.until("tasks run", lambda: any(r[2] == "RUNNING" and r[3] in w.names() for r in s.queue()))
    status, out = w.run("cancel")
    check("cancel", status == 0, out)
    s.until("all is gone", lambda: not w.names())
    check("and is not done", w.done() == [])
    open(w.path + "/go", "w").close()
    w.run("submit")
    s.until("resume", lambda: len(w.done()) == 9)
    # By somebody else, while it is waited for.
    w = Work(base, s, 'while [ ! -e "$w/go" ]; do sleep 0.2; done', "a=8", "b=1")
    p = w.start("wait")
    s.until("all are submitted, and tasks run", lambda: len(w.names()) == 9 and any(r[2] == "RUNNING" and r[3] in w.names() for r in s.queue()))
    time.sleep(1)
    for name in set(w.names()):
        s.run("scancel", "--name", name)
    out = p.communicate(timeout=200)[0]
    check("scancel from outside ends the wait", p.returncode == 1 and "cancelled from outside" in out and "resume" in out, out)
    s.until("all is gone", lambda: not w.names())  # a task that still ends is not submitted again
    open(w.path + "/go", "w").close()
    w.run("submit")
    s.until("resume", lambda: len(w.done()) == 9)


def controller(base, s):
    """The controller dies and comes back while tasks run; a driver that asks meanwhile goes on."""
    w = Work(base, s, 'while [ ! -e "$w/go" ]; do sleep 0.1; done', "a=3", "b=1")
    p = w.start("wait")
    s.until("tasks run", lambda: sum(r[2] == "RUNNING" for r in s.queue()) == 3)
    time.sleep(2)
    s.do("restart")
    s.queue()  # it answers
    time.sleep(2)
    open(w.path + "/go", "w").close()
    out = p.communicate(timeout=240)[0]
    check("the controller restarts", p.returncode == 0 and len(w.done()) == 4, out + w.logs())
    # Nodes that ran something then may be drained ("Duplicate jobid"): `show` has the command.
    for line in w.run("show")[1].splitlines():
        if line.startswith("trouble: node") and "scontrol update" in line:
            s.run(*line[line.index("scontrol update"):].split())
    s.until("all nodes are idle", lambda: s.run("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == "3")
    p = w.start("wait")
    p.send_signal(signal.SIGTERM)
    p.communicate(timeout=200)


def drained(base, s):
    s.run("scontrol", "update", "nodename=n3", "state=drain", "reason=Duplicate jobid")
    w = Work(base, s, "true", "a=1")
    status, out = w.run("show")
    check("a drained node", "trouble: node n3 is" in out and "Duplicate jobid" in out and "scontrol update nodename=n3 state=resume" in out, out)
    s.run("scontrol", "update", "nodename=n3", "state=resume")


with tempfile.TemporaryDirectory() as base, slurm(base + "/slurm", 3, array=6) as s:
    for part in asked(chain, throttle, lost_reply, full, killed, memory, cancelled, drained, node_lost, controller):
        part(base, s)
end()
