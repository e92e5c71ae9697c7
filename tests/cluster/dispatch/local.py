"""Tasks as processes of this machine, and as a script: order of phases, how many at once, what fails, what is left."""
import contextlib
import fcntl
import os
import signal
import subprocess
import tempfile
import time

from checks import asked, check, end
from dispatch_tasks import Tasks
from e2e import PATIENCE, until


class Work(Tasks):
    def __init__(self, base, body):
        super().__init__(tempfile.mkdtemp(dir=base), "local", "77", body, "0.2", {"DISPATCH_MOST": "2"})


def order(base):
    # The first tasks wait for each other; the last one of a phase, and any after those, for none.
    w = Work(base, 'case $p in b) [ "$(ls "$w"/done/a-* | wc -l)" = 5 ] || exit 9;; esac\n'
                   'n=$(mktemp -p "$w" now-XXXXXX)\n'
                   'for k in $(seq 3000); do ls "$w"/now-* | wc -l >>"$w/at"; grep -q "[2-9]" "$w/at" && break; sleep 0.02; done; sleep 0.2; rm "$n"')
    status, out = w.run("wait", "a=5", "none=0", "b=3", DISPATCH_MOST="3")
    check("all are done", status == 0 and len(w.done()) == 8 and "a 5 0 0 0" in out and "b 3 0 0 0" in out, out)
    with open(w.path + "/at") as f:
        most = max(int(n) for n in f)
    check("at most three at once, and more than one", 2 <= most <= 3, str(most))
    check("a log of each", "a 3 begins on" in w.log("a-3") and "a 3 ends with status 0" in w.log("a-3"), w.log("a-3"))
    os.unlink(w.path + "/done/b-1")
    status, out = w.run("wait", "a=5", "none=0", "b=3")
    check("only what has no record runs again", status == 0 and w.log("b-1").count("begins") == 2 and w.log("b-0").count("begins") == 1)


def failures(base):
    w = Work(base, 'if mkdir "$w/first-$p-$i" 2>/dev/null; then kill -9 $$; fi')
    status, out = w.run("wait", "a=2", "b=1")
    check("a killed task runs again", status == 0 and len(w.done()) == 3 and "a 0 is submitted again: signal" in out, out)
    w = Work(base, 'if [ $p$i = a1 ]; then echo the disk is on fire; exit 74; fi')
    status, out = w.run("wait", "a=3", "b=1")
    check("not for ever", status == 1 and "task a 1: failed with status 74" in out and "after 3 attempts" in out and
          "the disk is on fire" in out and "b-0" not in w.done() and w.log("a-1").count("begins") == 3, out)
    w = Work(base, 'if [ $p = b ]; then exit 74; fi')
    status, out = w.run("wait", "a=1", "b=1")
    check("not in a later phase either", status == 1 and "after 3 attempts" in out and w.log("b-0").count("begins") == 3, out)
    w = Work(base, 'echo what a file; exit 1')
    status, out = w.run("wait", "a=1")
    check("what repeats itself is not repeated", status == 1 and "after 1 attempt;" in out and "what a file" in out, out)
    w = Work(base, "true")
    os.unlink(w.task)
    status, out = w.run("wait", "a=1")
    check("no program", status == 1 and "No such file" in out, out)
    w = Work(base, 'exit 0')
    status, out = w.run("wait", "a=1", DISPATCH_MOST="1")
    check("status 0 without a record is no end", status == 1 and "no record" in out, out)


def lives(pid):
    try:
        with open("/proc/%d/stat" % pid) as f:
            return f.read().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


def stop(base):
    for how in (signal.SIGTERM, signal.SIGINT, signal.SIGKILL):
        w = Work(base, 'echo $$ >"$w/pid-$i"; exec sleep 50')
        p = w.start("wait", "a=2")
        until(lambda: all(os.path.exists(w.path + "/pid-%d" % i) and os.path.getsize(w.path + "/pid-%d" % i) for i in (0, 1)), "no task begins")
        pids = [int(open(w.path + "/pid-%d" % i).read()) for i in (0, 1)]
        p.send_signal(how)
        status = p.wait(PATIENCE)
        if how == signal.SIGKILL:  # it could not wait for them
            until(lambda: not any(lives(n) for n in pids), "the tasks of a killed driver live")
        check("a driver that ends with %s ends its tasks" % how.name, not any(lives(n) for n in pids), str(pids))
        check("its status", status == (3 if how != signal.SIGKILL else -9), str(status))


@contextlib.contextmanager
def locked(folder):
    """As by a driver that has started nothing yet."""
    fd = os.open(folder, os.O_RDONLY)
    fcntl.flock(fd, fcntl.LOCK_EX)
    try:
        yield
    finally:
        os.close(fd)


def at_once(base):
    w = Work(base, "sleep 0.05")
    both = [w.start("wait", "a=6", "b=3") for _ in range(4)]
    outs = [p.communicate(timeout=PATIENCE)[0] for p in both]
    check("four drivers at once", all(p.returncode == 0 for p in both) and all("b 3 0 0 0" in o for o in outs), str(outs))
    check("start each task once", all(w.log(n).count(" begins on ") == 1 for n in os.listdir(w.path + "/log")), str(outs))


def begun(w):
    """The first log names the driver, so others see it."""
    until(lambda: os.path.exists(w.path + "/log/a-0") and "begins on" in w.log("a-0"), "no task begins")


def two(base):
    """A second driver watches while the first one lives, goes on when that is killed, and cancel ends it."""
    w = Work(base, 'while [ ! -e "$w/go" ]; do sleep 0.1; done; sleep 0.05')
    phases = ["a=6", "b=3"]
    p = w.start("wait", *phases)
    begun(w)
    q = w.start("wait", *phases)
    time.sleep(0.5)
    open(w.path + "/go", "w").close()
    out = q.communicate(timeout=PATIENCE)[0]
    check("both see the end", p.wait(PATIENCE) == 0 and q.returncode == 0 and "a 6 0 0 0" in out and "b 3 0 0 0" in out, out)
    check("each task once", all(w.log(n).count(" begins on ") == 1 for n in os.listdir(w.path + "/log")), out)
    w = Work(base, "true")
    with locked(w.path + "/log"):
        p = w.start("wait", *phases)
        note = p.stdout.readline()
        check("who begins at the same instant waits", "another process starts the tasks" in note and not w.done(), note)
    out = p.communicate(timeout=PATIENCE)[0]
    check("and goes on", p.returncode == 0 and "b 3 0 0 0" in out and "again" not in out, out)
    w = Work(base, 'while [ ! -e "$w/go" ]; do sleep 0.1; done')
    p = w.start("wait", *phases)
    begun(w)
    q = w.start("wait", *phases)
    time.sleep(0.5)
    p.kill()
    open(w.path + "/go", "w").close()
    out = q.communicate(timeout=PATIENCE)[0]
    check("it goes on", p.wait(PATIENCE) == -9 and q.returncode == 0 and len(w.done()) == 9, out)
    w = Work(base, 'exec sleep 50')
    p = w.start("wait", *phases)
    begun(w)
    q = w.start("cancel", *phases)
    check("cancel ends the driver", p.wait(PATIENCE) == 3 and q.wait(PATIENCE) == 0)


def script(base):
    w = Work(base, 'case $p in b) [ "$(ls "$w"/done/a-* | wc -l)" = 3 ] || exit 9;; esac')
    open(w.path + "/done/a-1", "w").close()
    status, out = w.run("submit", "a=3", "b=1", scheduler="script")
    with open(w.path + "/script") as f:
        text = f.read()
    check("the script", status == 0 and text.count("# phase ") == 2 and text.count("\n'") == 3 and " a 1\n" not in text, text)
    p = subprocess.run(["sh", w.path + "/script"], capture_output=True, text=True)
    check("runs", p.returncode == 0 and len(w.done()) == 4, p.stderr)
    status, out = w.run("wait", "a=3", "b=1", scheduler="script")
    check("and is waited for", status == 0 and "b 1 0 0 0" in out, out)


with tempfile.TemporaryDirectory() as base:
    for part in asked(order, failures, stop, two, at_once, script):
        part(base)
end()
