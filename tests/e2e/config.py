"""The configuration of a daemon: --check-config, files and what overrides them, a reload by SIGHUP, and acutctl config show,
which tells the source of each setting."""
import json
import os
import re
import signal
import socket
import subprocess
import time

import e2e
from e2e import Daemon, Folder, expect, run


def write(path, text):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path + ".new", "w") as f:
        f.write(text)
    os.rename(path + ".new", path)


def without(command, option):
    at = command.index(option)
    return command[:at] + command[at + (1 if option == "--no-config" else 2):]


class Configured(Daemon):
    """A daemon with a configuration file, and a socket for its messages to the service manager."""

    def __init__(self, base, text, args=()):
        super().__init__(base, memory="64M", args=args)
        self.file = base + "/etc/acutd.conf"
        self.command = without(self.command, "--no-config") + ["--config", self.file]
        self.notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.notify.bind(base + "/notify")
        self.notify.settimeout(e2e.PATIENCE)
        self.env["NOTIFY_SOCKET"] = base + "/notify"
        write(self.file, text)

    def settings(self):
        lines = self.ctl("config", "show", "--json").ok().out.splitlines()
        return {s["name"]: s for s in map(json.loads, lines)}

    def told(self):
        """The next message to the service manager."""
        return self.notify.recv(4096).decode()

    def reload(self, text=None):
        if text is not None:
            write(self.file, text)
        self.notify.setblocking(False)
        try:
            while True:
                self.notify.recv(4096)
        except BlockingIOError:
            pass
        self.notify.setblocking(True)
        self.notify.settimeout(e2e.PATIENCE)
        before = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
        self.process.send_signal(signal.SIGHUP)
        first = self.told()
        while "RELOADING=1" not in first:
            first = self.told()
        at = int(first.split("MONOTONIC_USEC=")[1].split()[0])
        expect(before <= at <= time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000, "MONOTONIC_USEC is not now: %s" % first)
        while "READY=1" not in self.told():
            pass

    def since(self, mark):
        return self.log_text()[mark:]


def show_tells_where_from():
    with Folder() as base:
        write(base + "/etc/acutd.conf.d/10-a.conf", "keep-free = 1%\nuser-jobs = 7\n")
        write(base + "/etc/acutd.conf.d/20-b.conf", "\nuser-jobs = 8\n")
        with Configured(base, "# a comment\nkeep-free = 2%\ndisk = 50%\nthreads = 1\n") as d:
            s = d.settings()
            expect(s["threads"]["value"] == "2" and s["threads"]["origin"] == "command_line", "%s" % s["threads"])
            expect(s["keep-free"] == dict(name="keep-free", value="1%", default="5%", unit="bytes or % of the file system",
                                          reload=True, origin="file", file=base + "/etc/acutd.conf.d/10-a.conf", line=1),
                   "%s" % s["keep-free"])
            expect(s["user-jobs"]["value"] == "8" and s["user-jobs"]["line"] == 2 and "20-b" in s["user-jobs"]["file"], "user-jobs")
            expect(s["disk"]["value"] == "50%" and s["disk"]["line"] == 3, "disk")
            expect(s["space-wait"]["origin"] == "default" and s["space-wait"]["value"] == "1m", "%s" % s["space-wait"])
            expect(s["group"]["value"] is None and not s["memory"]["reload"], "group, memory")
            plain = d.ctl("config", "show").ok().out
            expect("disk\t50%\n" in plain and ".conf" not in plain.replace(d.file, ""), plain)
            told = d.ctl("config", "show", "--origin").ok().out
            expect("disk\t50%%\t%s:3\n" % d.file in told and "threads\t2\tcommand line\n" in told, told)
            expect(d.ctl("config", "show", "extra").status == 2 and d.ctl("config").status == 2, "usage")


def memory_by_cgroup_is_told():
    """An unset memory is the limit of the control group, or the default."""
    with Folder() as base:
        with Configured(base, "") as d:
            pass
        d.command = without(d.command, "--memory")
        with d:
            s = d.settings()["memory"]
            expect(s["origin"] in ("control_group", "default") and s["value"], "%s" % s)


def reload_has_its_effect():
    with Folder() as base:
        survey = os.path.join(base, "survey.las")
        run([e2e.SYNTH, "--points", "20000", survey]).ok()
        with Configured(base, "disk = 100K\nkeep-free = 0%\n") as d:
            refused = d.ctl("push", "a", survey)
            expect(refused.status == 74 and "--disk 100 KB" in refused.err, "%d %s" % (refused.status, refused.err))
            mark = len(d.log_text())
            d.reload("disk = 100M\nkeep-free = 0%\nlog-level = warning\nmemory = 1G\nstate = /elsewhere\n")
            log = d.since(mark)
            expect("disk is 100M now (%s:1), it was 100K" % d.file in log, log)
            # Both are of the command line, which beats the file: nothing to tell.
            expect("memory" not in log and "elsewhere" not in log, log)
            d.ctl("push", "a", survey).ok()
            expect("is done" not in d.since(mark), "log-level = warning: " + d.since(mark))
            d.reload("disk = 100M\nkeep-free = 0%\nlog-level = debug\n")
            mark = len(d.log_text())
            d.ctl("ping").ok()
            expect("client: pid" in d.since(mark), "log-level = debug: " + d.since(mark))
            # A setting that is left out is the default again.
            d.reload("")
            s = d.settings()
            expect(s["disk"]["value"] == "80%" and s["disk"]["origin"] == "default", "%s" % s["disk"])


def reload_tells_what_needs_a_restart():
    with Folder() as base:
        with Configured(base, "disk = 1G\n") as d:
            pass
        d.command = without(without(d.command, "--memory"), "--threads")
        write(d.file, "memory = 64M\nthreads = 1\n")
        with d:
            mark = len(d.log_text())
            d.reload("memory = 65M\nthreads = 2\nsocket = /elsewhere\nuser-jobs = 3\n")
            log = d.since(mark)
            expect("memory needs a restart of acutd to become 65M (%s:1); until then it is 64M" % d.file in log, log)
            expect("threads needs a restart" in log and "socket" not in log, log)
            s = d.settings()
            expect(s["memory"]["value"] == "64M" and s["threads"]["value"] == "1" and s["user-jobs"]["value"] == "3", "%s" % s)


def reload_of_errors_changes_nothing():
    with Folder() as base, Configured(base, "user-jobs = 3\n") as d:
        before = d.settings()
        mark = len(d.log_text())
        d.reload("user-jobs = 4\nmemroy = 3\ndisk = much\ngroup = no-such-group-here\n")
        log = d.since(mark)
        for what in (":2: there is no setting \"memroy\" (is memory meant?)", ":3: disk = much", ":4: there is no group",
                     "the configuration stays as it was: the configuration has 3 errors"):
            expect(what in log, "%s: %s" % (what, log))
        expect(d.settings() == before, "something changed")
        os.unlink(d.file)
        mark = len(d.log_text())
        d.reload()
        expect("cannot be read" in d.since(mark) and d.settings() == before, d.since(mark))
        d.reload("user-jobs = 4\n")
        expect(d.settings()["user-jobs"]["value"] == "4", "not mended")


def check(base, *args, env=None):
    return run([e2e.ACUTD, "--check-config", "--state", base + "/state", "--cache", base + "/cache", *args], timeout=e2e.PATIENCE, env=env)


def check_config():
    with Folder() as base:
        file = base + "/acutd.conf"
        got = check(base, "--init", "--no-config")
        expect(got.status == 0 and "no errors" in got.out and "disk = 80%  (default)" in got.out, got.out + got.err)
        expect(os.listdir(base) == [], "it wrote something: %s" % os.listdir(base))
        got = check(base, "--no-config")
        expect(got.status == 2 and "unmounted disk" in got.err, got.err)
        write(file, "user-jobs = 5\nuser-jobs = 6\nmemory = 64M\n")
        got = check(base, "--init", "--config", file)
        expect(got.status == 0 and "user-jobs = 6  (%s:2)" % file in got.out, got.out + got.err)
        expect("warning: %s:2: user-jobs was set in line 1 already" % file in got.err, got.err)
        write(file, "memroy = 1G\nthreads = none\n\ngroup = no-such-group-here\nsocket = %s/none/s\n" % base)
        got = check(base, "--init", "--config", file)
        expect(got.status == 2 and not got.out, "%d %s" % (got.status, got.out))
        for what in (":1: there is no setting", ":2: threads = none: a number from 1 to 256 is wanted", ":4: there is no group",
                     "none: the folder of the socket"):
            expect(what in got.err, "%s: %s" % (what, got.err))
        expect(len(got.err.splitlines()) == 4, got.err)
        # The start says the same, and its number.
        got = run([e2e.ACUTD, "--config", file, "--init", "--state", base + "/state", "--cache", base + "/cache"], timeout=e2e.PATIENCE)
        expect(got.status == 2 and "the configuration has 3 errors" in got.err and ":4: there is no group" in got.err, got.err)
        write(file, "disk = 0%\n")
        got = run([e2e.ACUTD, "--config", file, "--state", base + "/state", "--cache", base + "/cache"], timeout=e2e.PATIENCE)
        expect(got.status == 2 and len(got.err.splitlines()) == 1 and "acutd cannot start: %s:1: " % file in got.err, got.err)
        expect(not os.path.exists(base + "/state"), "a start with errors made a folder")
        with Daemon(base) as d:  # a check beside a daemon is no second one
            expect(check(base, "--no-config").status == 0, "beside a daemon")
            d.ctl("ping").ok()


def documents_are_of_the_table():
    """etc/acutd.conf and the manual agree with the table, and the file has the defaults."""
    doc = os.environ["ACUT_CONFIG_DOC"]
    source = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../..")
    with open(source + "/etc/acutd.conf") as f:
        conf = f.read()
    expect(run([doc, "conf"]).ok().out == conf, "etc/acutd.conf is not of the table: run config-doc conf > etc/acutd.conf")
    with open(source + "/daemon/config/config_table.def") as f:
        scopes = re.findall(r'^SETTING\("[a-z-]+", (\w+),.*?\b(RELOAD|RESTART|LINE),', f.read(), re.M | re.S)
    reload = [field for field, scope in scopes if scope == "RELOAD"]
    with open(source + "/daemon/settings.c") as f:
        applied = set(re.findall(r"\bc->(\w+)", f.read()))
    expect(len(reload) > 10, "%s" % reload)
    rest = [field for field in reload if not applied & {field, field + "_gid"}]
    expect(not rest, "a reload changes these by their scope, and daemon/settings.c does not read them: %s" % rest)
    settings = [line.lstrip("#") for line in conf.splitlines() if line.lstrip("#")[:1].isalpha() and " =" in line
                and not line.startswith("# ")]
    expect(len(settings) == len(re.findall(r"^SETTING", open(source + "/daemon/config/config_table.def").read(), re.M)) - 3, "%s" % settings)
    with Folder() as base:
        file = base + "/acutd.conf"
        write(file, "\n".join(s for s in settings if not s.startswith(("group", "admin-group"))) + "\n")
        own = check(base, "--init", "--no-config").ok().out.split("\n\n")[0]
        read = check(base, "--init", "--config", file).ok().out.split("\n\n")[0]
        plain = [re.sub(r"  \(.*", "", text) for text in (own, read)]
        expect(plain[0] == plain[1] and file in read, "%s\n%s" % (own, read))
    for name, mark, rows in (("acutd.8", "options", settings), ("acutd.conf.5", "keys", settings)):
        with open(os.path.join(source, "man", name + ".scd")) as f:
            page = subprocess.run([doc, mark], stdin=f, stdout=subprocess.PIPE, check=True).stdout.decode()
        for s in rows:
            key = s.split(" =")[0]
            expect(re.search(r"^\*%s%s\*" % ("--" if mark == "options" else "", key), page, re.M), "%s has no %s" % (name, key))
        expect("@SETTINGS@" not in page, name)
    told = run([e2e.ACUTD, "--help"]).ok().out
    for s in settings:
        expect("--%s " % s.split(" =")[0] in told, "--help has no %s" % s)


def more_memory_than_the_control_group_has():
    """A memory beyond the limit of the control group is refused, with the numbers: the kernel would kill the daemon."""
    # A limit by a folder that looks like /proc and /sys would need root; the rule is in tests/daemon/test_config_file.c.
    # Here a real control group, where one can be made.
    with open("/proc/self/cgroup") as f:
        rows = [line.strip().split(":", 2) for line in f]
    folders = [("/sys/fs/cgroup/memory" + p, "memory.limit_in_bytes") for _, c, p in rows if "memory" in c.split(",")]
    folders += [("/sys/fs/cgroup" + p, "memory.max") for _, c, p in rows if not c]
    group = None
    for folder, name in folders:
        try:
            group = os.path.join(folder, "acut-config-%d" % os.getpid())
            os.mkdir(group)
            with open(os.path.join(group, name), "w") as f:
                f.write(str(200 << 20))
            break
        except OSError:
            try:
                os.rmdir(group)
            except OSError:
                pass
            group = None
    if not group:
        print("skipped: no memory cgroup can be made here")
        return
    try:
        with Folder() as base:
            into = ["/bin/sh", "-c", 'echo $$ > "$0"/cgroup.procs && exec "$@"', group, e2e.ACUTD, "--no-config", "--check-config",
                    "--init", "--state", base + "/s", "--cache", base + "/c"]
            got = run(into, timeout=e2e.PATIENCE).ok()
            expect("memory = 152M  (limit of the control group, 200 MB, less 48 MB)" in got.out, got.out)
            run(into + ["--memory", "152M"], timeout=e2e.PATIENCE).ok()
            got = run(into + ["--memory", "153M"], timeout=e2e.PATIENCE)
            expect(got.status == 2 and "memory is 153 MB, but the control group has a limit of 200 MB, which leaves 152 MB" in got.err,
                   got.err)
            run(into + ["--memory", "168M", "--idle-exit", "30"], timeout=e2e.PATIENCE).ok()
            expect(run(into + ["--memory", "169M", "--idle-exit", "30"], timeout=e2e.PATIENCE).status == 2, "a private daemon")
    finally:
        for _ in range(50):
            try:
                os.rmdir(group)
                break
            except OSError:
                time.sleep(0.1)


if __name__ == "__main__":
    e2e.main(show_tells_where_from, memory_by_cgroup_is_told, reload_has_its_effect, reload_tells_what_needs_a_restart,
         reload_of_errors_changes_nothing, check_config, documents_are_of_the_table,
         more_memory_than_the_control_group_has)
