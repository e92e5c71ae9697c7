#!/usr/bin/python3
"""The drop folder in a real systemd: acut-ingest@ as installed, sandbox and all. Run in the container (run)."""
import json
import os
import shutil
import sys
import time

sys.path[:0] = ["/opt/acut/tree/tests/e2e", os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "e2e")]
import e2e
from e2e import expect, main
from protocol import some_points, write_las

FOLDER = "/var/lib/acut-ingest/valley"
# The settings are beside those of acutd, below the prefix.
ETC = next(d for d in ("/etc/acut", "/usr/local/etc/acut") if os.path.exists(d + "/acutd.conf"))


def sh(*args):
    return e2e.run(args, timeout=e2e.PATIENCE)


def ctl(*args):
    return e2e.run([e2e.ACUTCTL, "--socket", "/run/acut/acutd.sock"] + list(args), timeout=e2e.PATIENCE)


def until(what, cond, seconds=e2e.PATIENCE):
    deadline = time.monotonic() + seconds
    while not cond():
        expect(time.monotonic() < deadline, "%s: not within %d s\n%s" % (
            what, seconds, sh("journalctl", "--no-pager", "-n", "40", "-u", "acut-ingest@valley*", "-u", "acutd*").out))
        time.sleep(0.1)


def property_of(unit, name):
    return sh("systemctl", "show", "-p", name, "--value", unit).out.strip()


def names(sub):
    return sorted(os.listdir(os.path.join(FOLDER, sub))) if os.path.isdir(os.path.join(FOLDER, sub)) else []


def files_of(dataset):
    r = ctl("dataset", "show", dataset, "--json")
    return r.json()["files"] if r.status == 0 else 0


def settle(seconds):
    """Sets the --settle time of later passes."""
    with open(ETC + "/ingest/valley.conf", "w") as f:
        f.write("settle=%s\noptions=--assume-crs \"EPSG:25832\" --no-progress\n" % seconds)


def the_folder_comes_with_the_units():
    os.makedirs(ETC + "/ingest", exist_ok=True)
    settle(0.5)
    sh("systemctl", "start", "acutd.socket").ok()
    sh("systemctl", "start", "acut-ingest@valley.path", "acut-ingest@valley.timer").ok()
    until("the folder", lambda: names("") == ["done", "failed"])
    st = os.stat(FOLDER)
    user = sh("id", "-u", "acut-ingest").out.strip()
    expect(st.st_mode & 0o7777 == 0o2770 and str(st.st_uid) == user, "%o of %d" % (st.st_mode, st.st_uid))
    # Without files acutd is not started.
    until("the first pass", lambda: property_of("acut-ingest@valley.service", "ActiveState") == "inactive")
    expect(property_of("acutd.service", "ActiveState") == "inactive", "acutd was started for an empty folder")


def a_user_delivers():
    """A member of the group drops a file; it is in the dataset, and is meshed."""
    sh("useradd", "-m", "-G", "acut-ingest", "alice").ok()
    write_las("/srv/a.las", some_points(3000, 1))
    os.chmod("/srv/a.las", 0o644)
    got = sh("setpriv", "--reuid=alice", "--init-groups", "--regid=alice", "sh", "-c",
             "umask 027; cp /srv/a.las %s/a.las" % FOLDER)
    expect(got.status == 0, "alice may not deliver: %s" % got.err)
    until("a.las in done/", lambda: names("done") == ["a.las"])
    expect(files_of("valley") == 1, "the dataset has %d files" % files_of("valley"))
    mesh = ctl("submit", "valley", "--wait", "--json").ok().json()
    expect(mesh["vertices"] == 3000, "mesh: %s" % mesh)
    show = ctl("dataset", "show", "valley", "--json").ok().json()
    expect("25832" in json.dumps(show), "options of the file are not used: %s" % show)


def what_a_path_unit_cannot_see():
    """A slow copy: the path unit fires when it begins and when it ends, and the file is pushed complete."""
    write_las("/srv/slow.las", some_points(4000, 2))
    with open("/srv/slow.las", "rb") as f:
        data = f.read()
    until("rest", lambda: property_of("acut-ingest@valley.service", "ActiveState") == "inactive")
    settle(6) # longer than a pause within the copy
    with open(FOLDER + "/slow.las", "wb", buffering=0) as out:
        for at in range(0, len(data), len(data) // 25 + 1):
            out.write(data[at:at + len(data) // 25 + 1])
            time.sleep(0.1)
        expect("slow.las" not in names("done") + names("failed"), "half a file was taken")
    until("slow.las in done/", lambda: "slow.las" in names("done"))
    settle(0.5)
    # A file that comes while a pass runs is found by the timer at the latest, whose period is shortened here.
    os.makedirs("/run/systemd/system/acut-ingest@valley.timer.d", exist_ok=True)
    with open("/run/systemd/system/acut-ingest@valley.timer.d/test.conf", "w") as f:
        f.write("[Timer]\nOnUnitInactiveSec=\nOnUnitInactiveSec=2s\nAccuracySec=100ms\n")
    sh("systemctl", "daemon-reload").ok()
    sh("systemctl", "restart", "acut-ingest@valley.timer").ok()
    for i in range(40):
        write_las("/srv/many.las", some_points(100, 100 + i))
        shutil.move("/srv/many.las", FOLDER + "/many%d.las" % i)
        time.sleep(0.05)
    until("forty files", lambda: len([n for n in names("done") if n.startswith("many")]) == 40)
    expect(property_of("acut-ingest@valley.path", "ActiveState") == "active", "the path unit gave up")


def passes():
    sh("journalctl", "--sync")
    return sh("journalctl", "--no-pager", "-u", "acut-ingest@valley.service").out


def broken_files_and_an_absent_daemon():
    with open(FOLDER + "/broken.las", "wb") as f:
        f.write(b"LASF nothing")
    until("broken.las in failed/", lambda: names("failed") == ["broken.las", "broken.las.error"])
    with open(FOLDER + "/failed/broken.las.error") as f:
        expect(json.load(f)["error"]["message"], "no reason")
    until("broken.las in the journal", lambda: "broken.las" in passes())
    log = passes()
    for i, line in enumerate(log.splitlines()):
        expect("Starting" not in line and "Deactivated" not in line, "every pass is in the journal: " + line)
    # After a kill of acutd the socket starts it again, and nothing is lost.
    sh("systemctl", "kill", "-s", "KILL", "acutd.service")
    write_las("/srv/b.las", some_points(500, 3))
    shutil.move("/srv/b.las", FOLDER + "/b.las")
    until("b.las in done/", lambda: "b.las" in names("done"))
    # Without a socket the file stays; it is pushed when there is one again.
    sh("systemctl", "stop", "acutd.socket", "acutd.service").ok()
    os.makedirs("/run/systemd/system/acut-ingest@valley.service.d", exist_ok=True)
    with open("/run/systemd/system/acut-ingest@valley.service.d/test.conf", "w") as f:
        f.write("[Unit]\nWants=\n")
    sh("systemctl", "mask", "--runtime", "acutd.socket", "acutd.service")
    write_las("/srv/c.las", some_points(500, 4))
    shutil.move("/srv/c.las", FOLDER + "/c.las")
    until("a pass that fails", lambda: "ExecMainStatus=69" in sh("systemctl", "show", "-p", "ExecMainStatus", "acut-ingest@valley.service").out)
    expect("c.las" in names("") and "c.las" not in names("failed"), "%s" % names(""))
    sh("systemctl", "unmask", "--runtime", "acutd.socket", "acutd.service")
    sh("systemctl", "start", "acutd.socket").ok()
    until("c.las in done/", lambda: "c.las" in names("done"))
    expect(files_of("valley") == 44, "the dataset has %d files" % files_of("valley"))


def a_folder_at_rest_stays_at_rest():
    """Files that remain (foreign or not regular) do not trigger the units again and again."""
    os.remove("/run/systemd/system/acut-ingest@valley.timer.d/test.conf")
    sh("systemctl", "daemon-reload").ok()
    sh("systemctl", "restart", "acut-ingest@valley.timer").ok()
    os.symlink("/etc/shadow", FOLDER + "/link.las")
    os.mkfifo(FOLDER + "/fifo.las")
    with open(FOLDER + "/x.part", "w") as f:
        f.write("x")
    started = lambda: property_of("acut-ingest@valley.service", "ExecMainStartTimestampMonotonic")
    time.sleep(1)

    def rests():
        before = started()
        time.sleep(3)
        return before == started() and property_of("acut-ingest@valley.service", "ActiveState") == "inactive"
    until("rest: pass after pass is made for nothing", rests, 60)
    expect({"link.las", "fifo.las", "x.part"} <= set(names("")), "%s" % names(""))


def a_stop_is_no_failure():
    """A pass that waits for a file is stopped: the file stays, and systemctl --failed lists nothing."""
    sh("systemctl", "stop", "acut-ingest@valley.timer", "acut-ingest@valley.path").ok()
    with open(ETC + "/ingest/valley.conf", "w") as f:
        f.write("settle=60\n")
    write_las(FOLDER + "/stay.las", some_points(500, 5))
    sh("systemctl", "start", "--no-block", "acut-ingest@valley.service").ok()
    until("a pass that waits", lambda: "waiting until" in sh("journalctl", "--no-pager", "-u", "acut-ingest@valley.service", "-n", "1").out)
    sh("systemctl", "stop", "acut-ingest@valley.service").ok()
    expect(property_of("acut-ingest@valley.service", "ActiveState") == "inactive", property_of("acut-ingest@valley.service", "Result"))
    expect("stay.las" in names(""), "%s" % names(""))


# The installed files are read-only, so a copy is mounted over them.
sh("cp", "-a", ETC, "/run/etc-acut").ok()
sh("mount", "--bind", "/run/etc-acut", ETC).ok()
main(the_folder_comes_with_the_units, a_user_delivers, what_a_path_unit_cannot_see, broken_files_and_an_absent_daemon,
     a_folder_at_rest_stays_at_rest, a_stop_is_no_failure)
