"""What is asked of Slurm, with commands of a test's own in its place: a queue in a file, and states of tasks that are fixed in advance."""
import json
import os
import sys
import tempfile

from checks import asked, check, end
from dispatch_tasks import Tasks

FAKE = r'''#!%s -S
import json, os, re, sys
here, name, args = os.path.dirname(os.path.abspath(__file__)), os.path.basename(sys.argv[0]), sys.argv[1:]
path = os.path.join(here, "state.json")
with open(path) as f:
    s = json.load(f)
s["calls"].append([name, *args])
status = 0
if name == "scontrol":
    print("MaxArraySize = %d" % s["array"])
elif name == "squeue":
    print("\n".join("|".join(row) for row in s["queue"]))
elif name == "sbatch":
    s["env"] = [k for k in os.environ if re.match("SBATCH_|SQUEUE_|SCANCEL_|SLURM_CLUSTERS", k)]
    value = dict(a[2:].split("=", 1) for a in args if a.startswith("--") and "=" in a)
    s["job"] += 1
    print(s["job"])
    for run in value["array"].split("%")[0].split(","):
        first, _, last = run.partition("-")
        for i in range(int(first), int(last or first) + 1):
            phase = value["job-name"].split("-")[2]
            states = s["states"].get("%s-%d" % (phase, i), [])
            state = states.pop(0) if states else "COMPLETED"
            if state == "COMPLETED":
                open(os.path.join(here, "../done/%s-%d" % (phase, i)), "w").close()
            row = ["CANCELLED", "DependencyNeverSatisfied"] if state == "DROPPED" else [state, "None"]
            s["queue"].append([str(s["job"]), str(i), *row, value["job-name"]])
elif name == "scancel":
    status = int(args[-1] in s["stubborn"])
    if status:
        print("scancel: error: Kill job error on job id %s" % args[-1], file=sys.stderr)
    if not status or args[-1] in s["ends"]:
        s["queue"] = [q for q in s["queue"] if q[0] != args[-1]]
with open(path, "w") as f:
    json.dump(s, f)
sys.exit(status)
'''


class Work(Tasks):
    """`states`: of a task as "a-0", one a submission; then it is done."""

    def __init__(self, base, states=None, queue=(), stubborn=(), ends=(), array=1001):
        super().__init__(tempfile.mkdtemp(dir=base), "slurm", "77", "", "0.1")
        for name in ("fake", "sbatch", "squeue", "scontrol", "scancel"):
            with open(os.path.join(self.path, "bin", name), "w") as f:
                f.write(FAKE.replace("%s", sys.executable, 1))
            os.chmod(f.name, 0o755)
        with open(self.path + "/bin/state.json", "w") as f:
            json.dump({"calls": [], "queue": [list(q) for q in queue], "states": states or {}, "job": 100, "array": array, "stubborn": list(stubborn), "ends": list(ends)}, f)

    def state(self):
        with open(self.path + "/bin/state.json") as f:
            return json.load(f)

    def calls(self, name):
        return [c[1:] for c in self.state()["calls"] if c[0] == name]

    def submitted(self, *names):
        """The values of these options, a tuple a submission."""
        values = [dict(a[2:].split("=", 1) for a in c if a.startswith("--") and "=" in a) for c in self.calls("sbatch")]
        return [tuple(v.get(n) for n in names) for v in values]


def limits(base):
    """A task that needs more gets more; the others of its phase are asked for as before."""
    w = Work(base, {"a-0": ["OUT_OF_MEMORY", "OUT_OF_MEMORY"], "a-1": ["NODE_FAIL", "OUT_OF_MEMORY"], "a-2": ["TIMEOUT"]})
    status, out = w.run("wait", "a=4")
    got = w.submitted("array", "mem", "time")
    check("limits", status == 0 and got == [("0-3", "64M", "11"), ("0", "96M", "11"), ("1", "64M", "11"), ("2", "64M", "21"),
                                            ("0", "144M", "11"), ("1", "96M", "11")], "%s\n%s" % (got, out))


def attempts(base):
    """One that waited for the phase before counts when it has begun, and not when it was dropped."""
    w = Work(base, {"b-0": ["NODE_FAIL"] * 5})
    status, out = w.run("wait", "a=1", "b=1")
    check("a later phase", status == 1 and len(w.submitted("array")) == 1 + 3 and "node lost" in out, "%s\n%s" % (w.submitted("job-name"), out))
    w = Work(base, {"a-0": ["NODE_FAIL"] * 2, "b-0": ["DROPPED"] * 2 + ["NODE_FAIL"] * 2})
    status, out = w.run("wait", "a=1", "b=1")
    check("what was dropped", status == 0 and w.done() == ["a-0", "b-0"], "%s\n%s" % (w.submitted("job-name"), out))


def cancel(base):
    """A scancel that fails keeps none of the others from it."""
    queue = [[str(60 + k), "0", "PENDING", "None", "acut-77-" + p] for k, p in enumerate("abc")]
    w = Work(base, queue=queue, stubborn=["61", "62"])
    status, out = w.run("cancel", "a=1", "b=1", "c=1")
    check("all are asked for", sorted(c[-1] for c in w.calls("scancel")) == ["60", "61", "62"], str(w.calls("scancel")))
    check("what lives is an error", status == 1 and "job id 62" in out, out)
    w = Work(base, queue=queue, stubborn=["62"], ends=["62"])
    status, out = w.run("cancel", "a=1", "b=1", "c=1")
    check("what has ended is none", status == 0 and w.state()["queue"] == [], out)


def environment(base):
    """What is set for work by hand does not reach us."""
    w = Work(base)
    hands = {n: "1" for n in ("SBATCH_WAIT", "SBATCH_CLUSTERS", "SBATCH_ARRAY_INX", "SQUEUE_PARTITION", "SQUEUE_ACCOUNT", "SCANCEL_PARTITION", "SLURM_CLUSTERS")}
    status, out = w.run("wait", "a=1", SBATCH_ACCOUNT="survey", **hands)
    check("variables", status == 0 and w.state()["env"] == ["SBATCH_ACCOUNT"], "%s %s" % (w.state().get("env"), out))
    w = Work(base)
    status, out = w.run("wait", "a=1", DISPATCH_EXTRA=" ".join("--comment=%d" % k for k in range(100)))
    check("many options", status == 0 and w.calls("sbatch")[0][-100:] == ["--comment=%d" % k for k in range(100)], out)


def most(base):
    """--max-tasks is of the run: what is submitted again has what is left, or waits."""
    queue = [["60", str(k), "RUNNING", "None", "acut-77-a"] for k in range(3)]
    w = Work(base, queue=queue)
    status, out = w.run("submit", "a=9", "b=2", DISPATCH_MOST="5")
    check("what is left", status == 0 and w.submitted("array") == [("3-8%2",), ("0-1%5",)], "%s %s" % (w.submitted("array"), out))
    w = Work(base, queue=queue)
    status, out = w.run("submit", "a=9", "b=2", DISPATCH_MOST="3")
    check("nothing is left", status == 1 and w.submitted("array") == [] and "no more now" in out, "%s %s" % (w.submitted("array"), out))
    for n, wanted in (("7", "%2"), ("2", "%1")):
        w = Work(base, array=10)
        status, out = w.run("submit", "a=30", DISPATCH_MOST=n)
        check("several arrays", status == 0 and w.submitted("array") == [("0-9" + wanted,)] * 3, "%s %s" % (w.submitted("array"), out))


def owner(base):
    w = Work(base)
    w.run("show", "a=1", DISPATCH_USER="4321")
    check("the queue of the run's owner is asked for", all("4321" in c for c in w.calls("squeue")) and w.calls("squeue"), str(w.calls("squeue")))


with tempfile.TemporaryDirectory() as base:
    for part in asked(limits, attempts, cancel, environment, most, owner):
        part(base)
end()
