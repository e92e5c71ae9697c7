/* The options of acutctl, and what can be said of their values without knowing the command. */
#include <stddef.h>
#include <string.h>

#include "ctl.h"

#define AT(field) offsetof(struct program, field)

const struct cli_option ctl_options[] = {
	{"output", 'o', "OUT", CLI_LIST, AT(args.out), CTL_OUT, "write there; \"-\" is standard output; may be repeated"},
	{"format", 0, "FORMAT", CLI_TEXT, AT(args.format), CTL_OUT,
	 "what to write, where the name of OUT does not say it; null: nothing, without OUT"},
	{"max-edge", 0, "LENGTH", CLI_TEXT, AT(args.max_edge), CTL_OUT,
	 "leave out triangles with a longer xy edge: 12 in file units, or 12m, 40ft, 40ftUS"},
	{"z-unit", 0, "m|ft|ftUS", CLI_TEXT, AT(args.z_unit), CTL_OUT, "convert heights to this unit"},
	{"origin", 0, "X,Y,Z|auto", CLI_TEXT, AT(args.origin), CTL_OUT, "subtract this point from all coordinates"},
	{"canonical", 0, NULL, CLI_FLAG, AT(args.canonical), CTL_OUT,
	 "one order of vertices and triangles: the same mesh is the same file"},
	{"no-clobber", 0, NULL, CLI_FLAG, AT(args.no_clobber), CTL_OUT, "an OUT that exists is an error"},
	{"width", 0, "PIXELS", CLI_COUNT, AT(args.width), CTL_OUT, "width of a picture (1600)"},
	{"color", 0, "hillshade|elevation|domain", CLI_TEXT, AT(args.color), CTL_OUT, "what a picture shows (hillshade)"},
	{"resume", 0, NULL, CLI_FLAG, AT(args.resume), CTL_FETCH, "go on with what an earlier fetch has kept in OUT.part"},
	{"tile", 0, "SIZE", CLI_TEXT, AT(args.tile), CTL_OUT,
	 "one file a square of a grid of this side (file units); OUT is their folder"},
	{"trim", 0, "LENGTH", CLI_LATER, 0, CTL_OUT, NULL},
	{"mask", 0, "FILE", CLI_LATER, 0, CTL_OUT, NULL},
	{"changed-since", 0, "GENERATION", CLI_COUNT, AT(args.since), CTL_FETCH,
	 "only what differs from the mesh of that state; OUT.changes.geojson lists the regions"},

	{"class", 0, "LIST", CLI_TEXT, AT(view.classes), CTL_VIEW, "only points of these classes: 2,8 or 2-5"},
	{"not-class", 0, "LIST", CLI_TEXT, AT(view.not_classes), CTL_VIEW, "no points of these classes"},
	{"returns", 0, "all|first|last", CLI_TEXT, AT(view.returns), CTL_VIEW, "only these returns"},
	{"ground", 0, NULL, CLI_FLAG, AT(view.ground), CTL_VIEW, "classes 2 and 8 and key-points, the lowest of a position"},
	{"surface", 0, NULL, CLI_FLAG, AT(view.surface), CTL_VIEW, "first returns, the highest of a position"},
	{"keep-withheld", 0, NULL, CLI_FLAG, AT(view.keep_withheld), CTL_VIEW, "take withheld points too"},
	{"keep-noise", 0, NULL, CLI_FLAG, AT(view.keep_noise), CTL_VIEW, "take classes 7 and 18 too"},
	{"duplicates", 0, "lowest|highest", CLI_TEXT, AT(view.duplicates), CTL_VIEW,
	 "which of several points of one position (lowest)"},
	{"drop-overlap", 0, NULL, CLI_FLAG, AT(view.drop_overlap), CTL_VIEW,
	 "leave out points of overlapping strips (their flag; class 12 of old formats)"},
	{"zmin", 0, "Z", CLI_TEXT, AT(view.zmin), CTL_VIEW, "only points at this height or above (file units)"},
	{"zmax", 0, "Z", CLI_TEXT, AT(view.zmax), CTL_VIEW, "only points at this height or below"},
	{"crop", 0, "X1,Y1,X2,Y2|FILE", CLI_TEXT, AT(view.crop), CTL_VIEW,
	 "only points inside a box or the polygons of a GeoJSON or WKT file"},
	{"bbox", 0, "X1,Y1,X2,Y2", CLI_TEXT, AT(view.bbox), CTL_VIEW | CTL_FETCH,
	 "only those triangles of the whole mesh that meet this box"},
	{"polygon", 0, "FILE", CLI_TEXT, AT(view.polygon), CTL_VIEW | CTL_FETCH,
	 "likewise, the polygons of a GeoJSON or WKT file"},
	{"every", 0, "N", CLI_COUNT, AT(view.every), CTL_VIEW, "about one position of N, always the same ones"},
	{"thin", 0, "CELL", CLI_TEXT, AT(view.thin), CTL_VIEW,
	 "one point a square cell of this side: file units, or 10m, 30ft, 30ftUS"},
	{"thin-pick", 0, "lowest|highest|median", CLI_TEXT, AT(view.thin_pick), CTL_VIEW, "which point of a cell (lowest)"},
	{"constraints", 0, "FILE", CLI_LATER, 0, CTL_VIEW, NULL},

	{"scale", 0, "XY[,Z]", CLI_TEXT, AT(args.scale), CTL_STAGE | CTL_CREATE,
	 "lattice scale of a new dataset, in place of the inputs' finest"},
	{"mode", 0, "MODE", CLI_TEXT, AT(args.mode), CTL_PUSH | CTL_CREATE,
	 "of a dataset that comes to be: 640, o+r (of 640); unless given 666 less the umask"},
	{"crs", 0, "CRS", CLI_TEXT, AT(args.crs), CTL_CREATE, "EPSG:n, a WKT file, or a name that all inputs must be in"},
	{"planar", 0, NULL, CLI_FLAG, AT(args.planar), CTL_STAGE, "triangulate the file's own plane, degrees included"},
	{"accept-truncated", 0, NULL, CLI_FLAG, AT(args.accept_truncated), CTL_STAGE,
	 "take files that have fewer points than their header says, or a header that counts none"},
	{"strict", 0, NULL, CLI_FLAG, AT(args.strict), CTL_STAGE,
	 "one refused input refuses all, and one line without a value its input"},
	{"checksum", 0, NULL, CLI_FLAG, AT(args.checksum), CTL_PUSH,
	 "a file is the same if its content is, whatever its name and times; reads it"},
	{"add", 0, NULL, CLI_FLAG, AT(args.add), CTL_PUSH,
	 "take a file whose name is there with other content, or read otherwise, beside the old one"},
	{"replace", 0, NULL, CLI_FLAG, AT(args.replace), CTL_PUSH,
	 "take a file whose name is there with other content, or read otherwise, in place of the old one"},
	{"replaces", 0, "FILE", CLI_TEXT, AT(args.replaces), CTL_REPLACES,
	 "take the one input in place of this file of the dataset, by path or name"},
	{"settle", 0, "TIME", CLI_TEXT, AT(args.settle), CTL_INGEST,
	 "files are taken that have not changed for so long: 30 (unless said), 30s, 5m"},
	{"manifest", 0, "FILE", CLI_TEXT, AT(args.manifest), CTL_MANIFEST,
	 "all inputs must have the SHA-256 sums that FILE (of sha256sum) lists"},
	{"columns", 0, "LETTERS", CLI_TEXT, AT(args.columns), CTL_INPUT,
	 "columns of texts: x y z (or e n z), c class, r return, n number of returns, _ to skip one"},
	{"decimal-comma", 0, NULL, CLI_FLAG, AT(args.decimal_comma), CTL_INPUT, "numbers of texts have decimal commas: 123,45"},
	{"input-format", 0, "INPUT-FORMAT", CLI_TEXT, AT(args.input_format), CTL_INPUT,
	 "format of the inputs, in place of what their bytes say"},
	{"assume-crs", 0, "CRS", CLI_TEXT, AT(args.assume_crs), CTL_STAGE,
	 "EPSG:n, a WKT file, or a name, for inputs that say nothing"},
	{"assume-units", 0, "XY[,Z]", CLI_TEXT, AT(args.assume_units), CTL_STAGE,
	 "m, ft or ftUS, for inputs that do not say their units"},
	{"override-crs", 0, "CRS", CLI_TEXT, AT(args.override_crs), CTL_STAGE, "likewise, in place of what the inputs say"},
	{"override-units", 0, "XY[,Z]", CLI_TEXT, AT(args.override_units), CTL_STAGE,
	 "units in place of those that the inputs say"},
	{"utm", 0, "ZONE", CLI_TEXT, AT(args.utm), CTL_STAGE,
	 "project degrees to this zone (32N, 5S, UPS-N), not to that of their middle"},
	{"geoid", 0, "GEOID|FILE.pgm", CLI_TEXT, AT(args.geoid), CTL_STAGE,
	 "shift the heights by a kept geoid grid, or by a .pgm file"},
	{"geoid-way", 0, "orthometric|ellipsoidal", CLI_TEXT, AT(args.geoid_way), CTL_STAGE, "what they become (orthometric)"},
	{"header", 0, NULL, CLI_FLAG, AT(args.header), CTL_INFO, "read the headers only"},
	{"all", 0, NULL, CLI_FLAG, AT(args.all), CTL_CACHE, "everything that can be made again"},
	{"origin", 0, NULL, CLI_FLAG, AT(args.origin_of), CTL_CONFIG, "with the file and line that each comes from"},
	{"copy", 0, NULL, CLI_FLAG, AT(args.copy), CTL_COPY, "copy all files, also where a hard link would do"},
	{"textfile", 0, "FILE", CLI_TEXT, AT(args.textfile), CTL_METRICS,
	 "into this file, whole or not at all: for the node exporter"},
	{"name", 0, "NAME", CLI_TEXT, AT(args.name), CTL_GEOID | CTL_PUSH,
	 "under this name, not that of the file; push: of one INPUT"},

	{"wait", 0, NULL, CLI_FLAG, AT(args.wait), CTL_SUBMIT, "wait until the job is over and end with its status"},
	{"new", 0, NULL, CLI_FLAG, AT(args.fresh), CTL_SUBMIT, "a job of its own, even if there is the same already"},
	{"priority", 0, "low|normal|high", CLI_TEXT, AT(args.priority), CTL_JOB,
	 "before or after the jobs of others (high: administrators)"},
	{"at", 0, "GENERATION", CLI_COUNT, AT(args.generation), CTL_GENERATION, "of this state of the dataset, not the newest"},
	{"generation", 0, "GENERATION", CLI_COUNT, AT(args.generation), CTL_GENERATION, "the same as --at"},
	{"files", 0, NULL, CLI_FLAG, AT(args.files), CTL_DATASET, "log: with each file"},
	{"as", 0, "NAME", CLI_TEXT, AT(args.as), CTL_DATASET, "restore: under another name"},
	{"removed", 0, NULL, CLI_FLAG, AT(args.removed), CTL_REMOVED, "those that were removed and can be restored"},
	{"keep", 0, "N", CLI_COUNT, AT(args.keep), CTL_DATASET, "prune: so many of the newest generations stay"},
	{"before", 0, "GENERATION", CLI_COUNT, AT(args.before), CTL_DATASET, "prune: the generations before this one go"},

	{"memory", 0, "SIZE", CLI_TEXT, AT(session.opt.memory), CTL_OWN, "a daemon of this command's own, with this much memory"},
	{"threads", 0, "N", CLI_TEXT, AT(session.opt.threads), CTL_OWN, "the same, with this many threads"},
	{"cache", 0, "FOLDER", CLI_TEXT, AT(session.opt.cache), CTL_OWN, "the same, with this cache"},
	{"disk", 0, "SIZE|N%", CLI_TEXT, AT(session.opt.disk), CTL_OWN, "the same, which may hold so much on the disk"},
	{"keep-free", 0, "SIZE|N%", CLI_TEXT, AT(session.opt.keep_free), CTL_OWN,
	 "the same, which leaves so much of the disk free"},

	{"socket", 0, "PATH", CLI_TEXT, AT(session.opt.socket), CLI_ALL, "where the daemon listens"},
	{"private", 0, NULL, CLI_FLAG, AT(session.opt.own_private), CLI_ALL,
	 "use the user's private daemon, start it if need be"},
	{"timeout", 0, "TIME", CLI_SECONDS, AT(session.opt.timeout), CLI_ALL, "end with status 124 after 90, 90s, 5m, 2h"},
	{"json", 0, NULL, CLI_FLAG, AT(session.console.json), CLI_ALL, "results and errors as JSON"},
	{"quiet", 'q', NULL, CLI_FLAG, AT(session.console.quiet), CLI_ALL, "say nothing but errors and what was asked for"},
	{"no-progress", 0, NULL, CLI_FLAG, AT(session.console.no_progress), CLI_ALL, "no progress line"},
	{"help", 'h', NULL, CLI_FLAG, 0, CLI_ALL, "what the command does"},
};

const size_t ctl_noptions = sizeof(ctl_options) / sizeof(*ctl_options);

/* Written as it is, like "-", not replaced by a new file of its name. */
static bool is_standard_output(const char *path)
{
	return !strcmp(path, "/dev/stdout") || !strcmp(path, "/dev/fd/1") || !strcmp(path, "/proc/self/fd/1");
}

/* Values that can be judged without knowing the command. */
int ctl_option_check(struct program *ctl, struct err *err)
{
	const struct ctl_args *a = &ctl->args;

	for (unsigned i = 0; i < a->out.n; i++)
		if (is_standard_output(a->out.text[i]))
			ctl->args.out.text[i] = "-";
	for (size_t i = 0; a->input_format && ctl_formats_input[i].name; i++)
		if (ctl_formats_extension(&ctl_formats_input[i], a->input_format))
			ctl->args.input_format = ctl_formats_input[i].name; /* laz is read as las */
	return session_check(&ctl->session, err);
}
