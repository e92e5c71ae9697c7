"""COPC: a cropped mesh in one step reads only the nodes that meet the crop, and is the mesh of the whole file under the same
view. Points that were read in part are not used for a larger view."""
import os
import shutil

import e2e
from e2e import expect

DATA = e2e.data_dir()
if not DATA:
    e2e.skip("no test data: set ACUT_TEST_DATA")
GROUND = os.path.join(DATA, "lidar/las14_pdrf6_ground_21k.copc.laz")  # 5 nodes, 50 m square
SPREAD = os.path.join(DATA, "lidar/las14_pdrf7_1065.copc.laz")        # 65 nodes
LYING = os.path.join(DATA, "malformed/derived/copc_info_zero.copc.laz")  # the same, without its cube

AREA = "POLYGON((770501 6277501, 770519 6277502, 770505 6277523, 770501 6277501), " \
       "(770505 6277505, 770506 6277505, 770505 6277507, 770505 6277505))"


def identity(got):
    return got["digest"], got["vertex_digest"], got["triangles"]


def one_step(d, base, path, *view):
    out = os.path.join(base, "out.ply")
    run = d.ctl("mesh", "--json", "-o", out, *view, path).ok()
    got = run.json()
    os.unlink(out)
    return got, run.err


def same_mesh_from_less():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M", threads=3) as d:
        area = os.path.join(base, "area.wkt")
        with open(area, "w") as f:
            f.write(AREA)
        d.ctl("push", "ground", GROUND).ok()
        d.ctl("push", "spread", SPREAD).ok()
        cases = [("ground", GROUND, ["--crop", c], part) for c, part in (
            ("770500,6277500,770510.25,6277520", True), ("770530,6277530,770549,6277549.5", True),
            ("770500,6277500,770550,6277550", False), ("770523,6277523,770527,6277527", False))]
        cases += [("ground", GROUND, ["--crop", area], True),
                  ("ground", GROUND, ["--crop", "770500,6277500,770510,6277520", "--thin", "0.5", "--class", "2"], True),
                  ("spread", SPREAD, ["--crop", "635619.85,848899.7,636400,849900"], True),
                  ("spread", SPREAD, ["--crop", "635619.85,848899.7,638982.55,853535.43"], False)]
        for name, path, view, part in cases:
            got, _ = one_step(d, base, path, *view)
            job = d.ctl("submit", name, *view, "--wait").ok().out.split()[0]
            whole = d.ctl("show", job, "--json").ok().json()
            what = "%s %s" % (name, " ".join(view))
            expect(identity(got) == identity(whole) and got["triangles"] > 0,
                   "%s: %s, whole %s" % (what, identity(got), identity(whole)))
            read, = got["inputs"]
            expect(read["partial"] == part, "%s: partial is %s" % (what, read["partial"]))
            expect(part == (read["points"] < whole["points"]), "%s: %d points read" % (what, read["points"]))
            expect(read["bytes_total"] == os.path.getsize(path) and 0 < read["bytes_read"] < read["bytes_total"],
                   "%s: bytes %s" % (what, read))
            print("%s: %d of %d bytes, %d of %d points" % (what, read["bytes_read"], read["bytes_total"],
                                                          read["points"], whole["points"]), flush=True)


def nothing_there():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        out = os.path.join(base, "out.ply")
        got = d.ctl("mesh", "--json", "-o", out, "--crop", "0,0,1,1", GROUND).ok().json()
        expect(got["triangles"] == 0 and got["used"] == 0 and got["inputs"][0]["partial"], "not empty: %s" % got)
        expect(got["inputs"][0]["bytes_read"] == 0, "bytes were read for no point")


def text_tells_it():
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        run = d.ctl("mesh", "-o", os.path.join(base, "o.ply"), "--crop", "770500,6277500,770510,6277520", GROUND).ok()
        expect("1 COPC input read in part: " in run.err + run.out, "no line: %s%s" % (run.out, run.err))
        run = d.ctl("mesh", "-o", os.path.join(base, "o.ply"), GROUND).ok()
        expect("in part" not in run.err + run.out, "a line for a whole file: %s%s" % (run.out, run.err))


def a_lie_costs_a_warning():
    view = ["--crop", "635619.85,848899.7,636400,849900"]
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        path = os.path.join(base, "lying.copc.laz")
        shutil.copyfile(LYING, path)
        got, err = one_step(d, base, path, *view)
        true, _ = one_step(d, base, SPREAD, *view)
        expect(identity(got) == identity(true), "the lie changed the mesh")
        expect(not got["inputs"][0]["partial"] and got["inputs"][0]["points"] == 1065, "%s" % got["inputs"])
        expect(any("COPC hierarchy cannot be used" in w for w in got["warnings"]), "no warning: %s" % got["warnings"])


def serves_that_view_only():
    try:
        from acut_wire import Client, Refused, pb
    except ImportError as e:
        print("not tried: %s" % e)
        return
    box = (770500.0, 6277500.0, 770510.0, 6277520.0)

    def refused(client, code, body, value):
        try:
            client.ask(body, value)
        except Refused as e:
            expect(e.code == code, "%s, not %s: %s" % (e.code, code, e))
            return e.error
        raise e2e.Fault("%s was not refused" % value)

    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d, Client(d.socket) as c:
        done = c.push([GROUND], crop=box)
        for view in ("", "ask 1 class=2", "ask 1 crop=box:770500,6277500,770510.5,6277520",
                     "ask 1 crop=area@0:+AAIAAI"):
            error = refused(c, "usage", "submit", pb.Submit(dataset=done.dataset, view=view, bound=True))
            expect("770510" in error.message and error.hint, "says nothing: %s" % error)
            refused(c, "usage", "plan_request", pb.PlanRequest(dataset=done.dataset, view=view))
        for view in ("ask 1 crop=box:770500,6277500,770510,6277520", "ask 1 crop=box:770501,6277501,770505,6277510"):
            job = c.ask("submit", pb.Submit(dataset=done.dataset, view=view, bound=True))
            expect(c.wait(job.id).state == "done", "a view inside of the box failed")
        # whole: the box was no reason to leave anything out
        done = c.push([GROUND], crop=(0.0, 0.0, 1e7, 1e7))
        job = c.ask("submit", pb.Submit(dataset=done.dataset, bound=True))
        expect(c.wait(job.id).state == "done", "the whole file serves no view")
        refused(c, "usage", "push_begin", pb.PushBegin(dataset="named", crop=box))
        for bad in ((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 1.0), (float("nan"), 0.0, 1.0, 1.0), (0.0, 0.0, float("inf"), 1.0)):
            refused(c, "protocol", "push_begin", pb.PushBegin(crop=bad))


e2e.main(same_mesh_from_less, nothing_there, text_tells_it, a_lie_costs_a_warning, serves_that_view_only)
