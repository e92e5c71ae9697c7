"""A process at rest: its wake-ups and its child processes."""
import os
import time

from e2e import until


def children(pid):
    """The processes below it, nearest first."""
    parents = {}
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open("/proc/%s/stat" % name) as f:
                parents[int(name)] = int(f.read().rsplit(")", 1)[1].split()[1])
        except OSError:
            pass
    found = [pid]
    for p in found:
        found += [c for c in sorted(parents) if parents[c] == p]
    return found[1:]


def used(pid):
    """Wake-ups of all its threads (voluntary switches, without preemptions), and seconds of CPU time."""
    woken = 0
    for task in os.listdir("/proc/%d/task" % pid):
        try:
            with open("/proc/%d/task/%s/status" % (pid, task)) as f:
                woken += sum(int(line.split()[1]) for line in f if line.startswith("voluntary_ctxt_switches"))
        except (FileNotFoundError, ProcessLookupError):
            pass  # it has ended
    with open("/proc/%d/stat" % pid) as f:
        ticks = sum(int(v) for v in f.read().rsplit(")", 1)[1].split()[11:13])
    return woken, ticks / os.sysconf("SC_CLK_TCK")


def rests(pid, woken, cpu, seconds=1.0):
    """Waits for a period of that many seconds with at most so many wake-ups and so much CPU time. A process that wakes up for
    nothing never has one; a process that still works gets the time to finish."""
    least = None

    def at_rest():
        nonlocal least
        before, start = used(pid), time.monotonic()
        time.sleep(seconds)
        now, took = used(pid), time.monotonic() - start
        got = (now[0] - before[0], now[1] - before[1], took)
        least = min(least or got, got)
        return took < 2 * seconds and 0 <= got[0] <= woken and got[1] <= cpu and got

    return until(at_rest, lambda: "it does not come to rest: woken %d times, %.2f s of CPU in %.1f s at least" % least)
