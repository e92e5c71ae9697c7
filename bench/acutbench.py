"""Shared by the programs of bench: result lines, private daemons, and the costs of runs.

A result line has seven words: NAME VALUE UNIT RATIO N MIN MAX. VALUE is the median of N measurements, MIN and MAX their range,
RATIO the ratio to a peer or predecessor, - if there is none. Lines that begin with # are comments.
"""
import contextlib
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

TICK = os.sysconf("SC_CLK_TCK")
HERE = os.path.dirname(os.path.abspath(__file__))
RAISES = ("GB/s", "Mpt/s")  # units of which more is better; of all others less is


class Failed(Exception):
    pass


def count(text):
    """12, 12k, 1.5M, 2G in powers of a thousand."""
    units = {"k": 10**3, "M": 10**6, "G": 10**9}
    scale = units.get(text[-1:], 1)
    try:
        value = float(text[:-1] if scale > 1 else text) * scale
    except ValueError:
        value = -1
    if value < 1 or value != int(value):
        raise Failed("'%s' is not a number of points such as 10M" % text)
    return int(value)


def short(n):
    for unit, scale in (("G", 10**9), ("M", 10**6), ("k", 10**3)):
        if n >= scale and n % scale == 0:
            return "%d%s" % (n // scale, unit)
    return str(n)


def size_bytes(text):
    return int(text[:-1]) * {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30}[text[-1]]


# ---- lines ----

class Line:
    def __init__(self, name, value, unit, ratio=None, n=1, low=None, high=None):
        self.name, self.value, self.unit, self.ratio, self.n = name, value, unit, ratio, n
        self.low = value if low is None else low
        self.high = value if high is None else high

    @staticmethod
    def of(name, values, unit, ratio=None):
        return Line(name, statistics.median(values), unit, ratio, len(values), min(values), max(values))

    def __str__(self):
        ratio = "-" if self.ratio is None else number(self.ratio)
        return "%-44s %12s %-9s %8s %3d %12s %12s" % (self.name, number(self.value), self.unit, ratio, self.n,
                                                      number(self.low), number(self.high))


def number(v):
    if v == int(v) and abs(v) < 1e15:
        return "%d" % v
    return "%.4g" % v if abs(v) < 1000 else "%.1f" % v


HEAD = "# %-42s %12s %-9s %8s %3s %12s %12s" % ("name", "value", "unit", "ratio", "n", "min", "max")


def parse(text, where):
    """The result lines of a kept file: {name: Line}, in order."""
    lines = {}
    for i, row in enumerate(text.splitlines(), 1):
        words = row.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            if len(words) != 7:
                raise ValueError
            name, value, unit, ratio, n, low, high = words
            line = Line(name, float(value), unit, None if ratio == "-" else float(ratio), int(n), float(low), float(high))
        except ValueError:
            raise Failed("%s: line %d is not NAME VALUE UNIT RATIO N MIN MAX: %s" % (where, i, row)) from None
        if name in lines:
            raise Failed("%s: line %d: %s is there twice" % (where, i, name))
        lines[name] = line
    return lines


class Table:
    """Prints each line as it comes, and keeps all."""

    def __init__(self):
        self.text, self.lines = [], {}
        self.words("name VALUE is the median of n")

    def words(self, text):
        if text == "name VALUE is the median of n":
            row = HEAD
        else:
            row = "\n".join("# " + t for t in text.splitlines())
        self.text.append(row)
        print(row, flush=True)

    def add(self, name, values, unit, ratio=None):
        values = values if isinstance(values, (list, tuple)) else [values]
        self.put(Line.of(name, values, unit, ratio))

    def put(self, line):
        self.lines[line.name] = line
        self.text.append(str(line))
        print(line, flush=True)

    def keep(self, folder, stem):
        """A dated file that is not there yet."""
        date = time.strftime("%Y-%m-%d")
        for i in range(1, 1000):
            path = os.path.join(folder, "%s-%s%s.txt" % (date, stem, "" if i == 1 else "-%d" % i))
            try:
                with open(path, "x") as f:
                    f.write("\n".join(self.text) + "\n")
                return path
            except FileExistsError:
                continue
        raise Failed("%s is full of today's results" % folder)


# ---- the machine ----

def first_line(path, key, default="unknown"):
    try:
        with open(path) as f:
            for row in f:
                if row.startswith(key):
                    return row.split(":", 1)[-1].strip()
    except OSError:
        pass
    return default


def output(*args):
    try:
        return subprocess.run(args, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True).stdout.decode()
    except (OSError, subprocess.CalledProcessError):
        return ""


def file_system(path):
    best, kind = "", "unknown"
    path = os.path.realpath(path)
    with open("/proc/mounts") as f:
        for row in f:
            device, where, fs = row.split()[:3]
            inside = path == where or path.startswith(where.rstrip("/") + "/")
            if inside and len(where) >= len(best):
                best, kind = where, fs
    return kind


def machine(build, work):
    """A few lines about the machine, the build and how busy it is."""
    version = compiler = buildtype = "unknown"
    info = output("meson", "introspect", "--projectinfo", "--buildoptions", build)
    try:
        info = json.loads(info)
        version = info["projectinfo"]["version"]
        options = {o["name"]: o["value"] for o in info["buildoptions"]}
        buildtype = "%s, b_sanitize=%s" % (options["buildtype"], options.get("b_sanitize", "none"))
    except (ValueError, KeyError):
        pass
    compiler = (output("cc", "--version").splitlines() or ["unknown"])[0]
    memory = int(first_line("/proc/meminfo", "MemTotal", "0 kB").split()[0]) >> 20
    u = os.uname()
    return ("acut %s, %s, build %s\n" % (version, time.strftime("%Y-%m-%d %H:%M"), buildtype) +
            "CPU %s, %d in use, memory %d GiB\n" % (first_line("/proc/cpuinfo", "model name"), len(os.sched_getaffinity(0)),
                                                    memory) +
            "%s %s, %s, file system of %s: %s, load at the start %.1f" % (u.sysname, u.release, compiler, work,
                                                                         file_system(work), os.getloadavg()[0]))


# ---- processes ----

def proc_io(pid):
    with open("/proc/%d/io" % pid) as f:
        return {k: int(v) for k, v in (row.split(":") for row in f)}


def proc_cpu(pid):
    """User and system seconds so far."""
    with open("/proc/%d/stat" % pid) as f:
        words = f.read().rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / TICK


def proc_hwm(pid):
    """Most bytes ever resident; 0 if it has gone."""
    try:
        return int(first_line("/proc/%d/status" % pid, "VmHWM", "0 kB").split()[0]) << 10
    except (ValueError, IndexError):
        return 0


class Ended:
    """A finished process: its output and its costs."""

    def __init__(self, args, status, out, err, wall, cpu, hwm):
        self.args, self.status, self.out, self.err, self.wall, self.cpu, self.hwm = args, status, out, err, wall, cpu, hwm

    def ok(self):
        if self.status:
            raise Failed("%s\nended with %d\n%s%s" % (" ".join(self.args), self.status, self.out, self.err))
        return self


class Watched:
    """A process whose peak memory is sampled (wait4 would include that of the parent before exec)."""

    def __init__(self, args, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, env=None):
        self.args = [str(a) for a in args]
        self.err = tempfile.TemporaryFile()
        self.start = time.monotonic()
        self.process = subprocess.Popen(self.args, stdin=stdin, stdout=stdout, stderr=self.err, env=env)
        self.out, self.hwm, self.over = b"", 0, threading.Event()
        self.threads = [threading.Thread(target=self.look)]
        if stdout == subprocess.PIPE:
            self.threads.append(threading.Thread(target=self.read))
        for t in self.threads:
            t.start()

    def look(self):
        while not self.over.wait(0.05):
            self.hwm = max(self.hwm, proc_hwm(self.process.pid))

    def read(self):
        self.out = self.process.stdout.read()
        self.process.stdout.close()

    def wait(self):
        _, status, usage = os.wait4(self.process.pid, 0)
        wall = time.monotonic() - self.start
        self.process.returncode = os.waitstatus_to_exitcode(status)
        self.over.set()
        for t in self.threads:
            t.join()
        self.err.seek(0)
        err = self.err.read().decode(errors="replace")
        self.err.close()
        return Ended(self.args, self.process.returncode, self.out.decode(errors="replace"), err, wall,
                     usage.ru_utime + usage.ru_stime, self.hwm)


def run(*args, **kw):
    return Watched(args, **kw).wait()


class Tools:
    """The programs of a build folder."""

    def __init__(self, build):
        self.build = os.path.abspath(build)
        if not os.path.exists(os.path.join(self.build, "build.ninja")):
            raise Failed("%s is not a build folder: run 'meson setup %s' first" % (build, build))
        self.acutd, self.acutctl = self.path("daemon/acutd"), self.path("client/acutctl/acutctl")
        self.synth = self.path("tools/acut-synth")

    def path(self, name):
        return os.path.join(self.build, name)

    def have(self, name):
        return os.path.exists(self.path(name))

    def make(self, targets):
        """Builds the targets one by one; those that this build lacks are left out."""
        for target in targets:
            r = subprocess.run(["ninja", "-C", self.build] + target.split(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            text = r.stdout.decode(errors="replace")
            if r.returncode and "unknown target" not in text:
                raise Failed("ninja -C %s %s\n%s" % (self.build, target, text[-3000:]))


class Daemon:
    """An acutd with folders of its own; with Daemon(...) as d: d.json("status")."""

    def __init__(self, tools, folder, memory="256M", threads=2, name="d"):
        self.tools, self.folder = tools, folder
        self.socket = os.path.join(folder, name + ".sock")
        self.state, self.cache = os.path.join(folder, name + "-state"), os.path.join(folder, name + "-cache")
        self.log = os.path.join(folder, name + ".log")
        self.args = [tools.acutd, "--no-config", "--socket", self.socket, "--init", "--state", self.state, "--cache", self.cache, "--memory", memory,
                     "--threads", str(threads), "--log-level", "warning"]
        self.env = dict(os.environ, ACUT_SOCKET=self.socket)
        self.process, self.start_seconds = None, None

    def start(self):
        with open(self.log, "ab") as log:
            begun = time.monotonic()
            self.process = subprocess.Popen(self.args, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        while time.monotonic() - begun < 60:
            if self.process.poll() is not None:
                break
            if os.path.exists(self.socket):
                r = subprocess.run([self.tools.acutctl, "ping"], env=self.env, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL)
                if r.returncode == 0:
                    self.start_seconds = time.monotonic() - begun
                    return self
            time.sleep(0.001)
        raise Failed("acutd did not start\n" + open(self.log, errors="replace").read()[-3000:])

    @property
    def pid(self):
        return self.process.pid

    def ctl(self, *args, stdin=subprocess.DEVNULL):
        return run(self.tools.acutctl, *args, env=self.env, stdin=stdin)

    def json(self, *args, **kw):
        return json.loads(self.ctl(*args, "--json", "--no-progress", **kw).ok().out.splitlines()[-1])

    def stop(self):
        if self.process and self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def __enter__(self):
        return self.start()

    def __exit__(self, *exc):
        self.stop()


class Folder:
    """A temporary folder below `where`."""

    def __init__(self, where):
        self.where = where

    def __enter__(self):
        self.path = tempfile.mkdtemp(prefix="acut-bench-", dir=self.where)
        return self.path

    def __exit__(self, *exc):
        shutil.rmtree(self.path, ignore_errors=True)


def null_format(tools):
    """Whether acutctl can read a mesh without writing it."""
    return '"null"' in output(tools.acutctl, "formats", "--json")


class Piped:
    """A survey from acut-synth through a pipe into one mesh of a daemon, with the costs of each side."""

    def __init__(self, daemon, points, options, folder, extra=()):
        tools, head = daemon.tools, os.path.join(folder, "head-%d" % points)
        synth = [tools.synth, "--points", points, "--head", head, *options, "-"]
        with open(os.devnull, "wb") as null:
            if not os.path.exists(head):
                run(*synth, stdout=null).ok()
            self.alone = run(*synth, stdout=null).ok()  # the generator by itself
        before, cpu = proc_io(daemon.pid), proc_cpu(daemon.pid)
        made = os.path.join(folder, "piped.ply")
        out = ["--format", "null"] if null_format(tools) else ["-o", made]
        r, w = os.pipe()
        maker = Watched(synth, stdout=w, env=daemon.env)
        os.close(w)
        client = Watched([tools.acutctl, "mesh", "-", "--input-format", "las", "--json", "--no-progress", *out, *extra],
                         stdin=r, env=daemon.env)
        os.close(r)
        self.client, self.maker = client.wait(), maker.wait()
        if os.path.exists(made):
            os.unlink(made)
        self.client.ok()
        self.maker.ok()
        after = proc_io(daemon.pid)
        self.report = json.loads(self.client.out.splitlines()[-1])
        self.io = {k: after[k] - before[k] for k in after}
        self.cpu = proc_cpu(daemon.pid) - cpu
        self.hwm = proc_hwm(daemon.pid)
        self.wall = self.client.wall


# ---- views beside each other ----

def threads_cpu(pid):
    """Seconds so far, of all threads, finer than a tick."""
    total = 0
    for thread in os.listdir("/proc/%d/task" % pid):
        with open("/proc/%d/task/%s/schedstat" % (pid, thread)) as f:
            total += int(f.read().split()[0])
    return total / 1e9


class Meshes:
    """One dataset in one view, and what its meshes cost; `refused` is why there is none."""

    def __init__(self, d, name, title, view):
        self.d, self.name, self.title, self.view, self.cpu, self.ratios = d, name, title, view, [], []

    def run(self, base=None, may_refuse=False):
        """Another mesh, without what was kept of earlier ones. `base`: the seconds of what it is compared with."""
        self.d.ctl("cache", "gc", "--all").ok()
        before = threads_cpu(self.d.pid)
        ended = self.d.ctl("submit", self.name, "--wait", "--new", "--json", "--no-progress", *self.view)
        self.report = json.loads(ended.out.splitlines()[-1])
        self.refused = (self.report.get("error") or {}).get("message")
        if not (self.refused and may_refuse):
            ended.ok()
        self.cpu.append(threads_cpu(self.d.pid) - before)
        if base:
            self.ratios.append(self.cpu[-1] / base)
        return self.cpu[-1]

    def ratio(self):
        return statistics.median(self.ratios)

    def fetch(self, path, *verify):
        """Writes the last mesh, and checks it by acut-verify with these arguments, the files of points last."""
        self.d.ctl("fetch", self.report["job"], "-o", path).ok()
        view = self.d.json("show", self.report["job"])["view"]
        run(self.d.tools.path("tools/acut-verify"), "--quiet", "--view", view, *verify[:-1], path, verify[-1]).ok()


def daemon_arguments(parser, memory, runs, note=""):
    parser.add_argument("--memory", default=memory, help="of acutd%s (%s)" % (note, memory))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--runs", type=int, default=runs)
    parser.add_argument("--acutd", help="measure this one, in place of that of the build")
    parser.add_argument("--work", default="/tmp", help="where folders are made (/tmp)")
    parser.add_argument("--keep", action="store_true", help="keep the table in bench/results/ (or --results)")
    parser.add_argument("--results", default=os.path.join(HERE, "results"), help="where --keep writes")


@contextlib.contextmanager
def one_daemon(args, words):
    """A daemon as daemon_arguments say: itself, a folder, and a table that begins with the machine and these words."""
    tools, table = Tools(args.build), Table()
    tools.acutd = args.acutd or tools.acutd
    table.words(machine(args.build, args.work))
    table.words("%s, memory %s, %d thread(s)" % (words, args.memory, args.threads))
    with Folder(args.work) as folder, Daemon(tools, folder, memory=args.memory, threads=args.threads) as d:
        yield d, folder, table


def main(body):
    """Runs a program's body. A failure is printed in one sentence; an interrupt prints nothing."""
    try:
        sys.exit(body())
    except Failed as e:
        print("%s: %s" % (os.path.basename(sys.argv[0]), e), file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(141)
