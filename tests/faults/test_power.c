/*
 * Power cuts in process: the play is recorded once, then cut after any entry of the log, with anything or nothing of what
 * was not yet synced; a service is opened over each such disk, and all that was acknowledged by then must be there and right,
 * the rest be done again. Some of these are cut a second time while the service is being put in order.
 *
 * Two controls: without fsync of files, and without fsync of folders, data must be lost, or the test sees nothing.
 *
 * ACUT_FAULT_CUTS: how many cuts (600).
 */
#include "scene.h"

#include "disk_states.h"

static struct scene_digests want;
static size_t entries;
static unsigned long cuts;
static bool no_file_sync, no_folder_sync;

/* Spread over the log, so that few cuts see all of it; what survives: nothing, all, and six times something. */
static struct disk_cut cut_of(unsigned long i)
{
	struct disk_cut c = {.no_file_sync = no_file_sync, .no_folder_sync = no_folder_sync};

	c.at = 1 + (size_t)((double)(i / 2 * 2 + (i & 1)) * (double)(entries - 1) / (double)cuts);
	c.seed = i % 8;
	if (c.seed > 1)
		c.seed = i + 2;
	return c;
}

static uint64_t marks_before(size_t at)
{
	const struct disk_entry *log;
	uint64_t mark = 0;

	fault_log(&log);
	for (size_t i = 0; i < at; i++)
		if (log[i].op == DISK_MARK)
			mark = log[i].n;
	return mark;
}

static void settled(uint64_t marks)
{
	open_service(SCENE_MEMORY, 2);
	check_all(marks, &want);
	close_service();
}

static void one_cut(unsigned long i)
{
	struct disk_cut c = cut_of(i);
	unsigned fds = open_files();

	if ((no_file_sync || no_folder_sync) && !freopen("/dev/null", "w", stdout))
		abort(); /* what is lost there is meant to be */
	after_crash = true;
	new_folder(i);
	disk_state_make(&c, h.folder);
	if (i % 4 == 3) {
		/* Once more, in the middle of what comes after. */
		uint64_t marks = marks_before(c.at);
		const struct disk_entry *log;
		size_t n, before;

		fault_log_start(h.folder);
		before = fault_log(&log);
		settled(marks);
		fault_log_stop();
		drop_folder();
		n = fault_log(&log);
		c.at = n - (n - before) * (i % 97) / 97;
		c.seed = i + 2;
		new_folder(i);
		disk_state_make(&c, h.folder);
		settled(marks);
	} else {
		settled(marks_before(c.at));
	}
	must(open_files() == fds);
	must(clean());
	drop_folder();
}

static void tell(unsigned long i, int status)
{
	struct disk_cut c = cut_of(i);

	printf("cut %lu: after entry %zu of %zu, seed %llu, mark %llu: status %x\n", i, c.at, entries, (unsigned long long)c.seed,
	       (unsigned long long)marks_before(c.at), status);
}

static unsigned long control(const char *what, unsigned long n)
{
	unsigned long lost;

	cuts = n;
	lost = each_apart(n, one_cut, NULL);
	printf("control, %s: %lu cuts, %lu of them lose something\n", what, n, lost);
	return lost;
}

/* ACUT_FAULT_LOG: what the cuts are numbered by. */
static void print_log(void)
{
	static const char *const op[] = {"create", "write", "size", "sync", "rename", "unlink", "link", "MARK"};
	const struct disk_entry *log;
	size_t n = fault_log(&log);

	for (size_t i = 0; i < n; i++)
		printf("%4zu %-6s node %u in %u %s %u %s at %llu n %llu\n", i, op[log[i].op], log[i].node, log[i].dir,
		       log[i].name ? log[i].name : "", log[i].dir2, log[i].name2 ? log[i].name2 : "",
		       (unsigned long long)log[i].at, (unsigned long long)log[i].n);
}

int main(void)
{
	unsigned long n = (unsigned long)setting("ACUT_FAULT_CUTS", 600), lost, lost_files, lost_folders;
	const struct disk_entry *log;
	double begun = seconds();

	log_init("power", LOG_LEVEL_ERROR);
	fault_io_start();
	scene_begin();
	new_folder(0);
	fault_log_start(h.folder);
	open_service(SCENE_MEMORY, 2);
	play(&want);
	close_service();
	fault_log_stop();
	drop_folder();
	entries = fault_log(&log);
	if (setting("ACUT_FAULT_LOG", 0))
		print_log();
	cuts = n;
	lost = each_apart(n, one_cut, tell);
	printf("%lu power cuts in process over %zu disk operations, a quarter of them twice: %lu losses, %.1f s\n", n, entries,
	       lost, seconds() - begun);
	fflush(stdout);
	if (!freopen("/dev/null", "w", stderr))
		abort();
	no_file_sync = true;
	lost_files = control("no fsync of files", 40);
	no_file_sync = false;
	no_folder_sync = true;
	lost_folders = control("no fsync of folders", 40);
	scene_end();
	return lost || !lost_files || !lost_folders;
}
