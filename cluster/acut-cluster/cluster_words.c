/*
 * The words of a run: those of its command without its inputs, and an option for each setting of cluster.conf that the command
 * does not give itself. A run does not change when that file does.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cluster.h"

struct list {
	char **word;
	size_t n, room;
	bool failed;
};

static void add(struct list *l, const char *head, const char *text)
{
	char *copy = NULL;

	if (l->n + 1 >= l->room) {
		size_t room = 2 * l->room + 32;
		char **grown = realloc(l->word, room * sizeof *grown);

		l->failed |= !grown;
		if (!grown)
			return;
		l->word = grown;
		l->room = room;
	}
	if (asprintf(&copy, "%s%s", head, text) < 0)
		l->failed = true;
	else
		l->word[l->n++] = copy;
	l->word[l->n] = NULL;
}

/* Whether an option of the command stands for the setting. */
static bool is_given(const struct program *p, size_t id)
{
	const struct cluster_options *o = &p->opt;

	switch ((enum cluster_setting)id) {
	case CLUSTER_SCHEDULER_NAME:
		return o->on;
	case CLUSTER_PARTITION:
		return o->partition;
	case CLUSTER_ACCOUNT:
		return o->account;
	case CLUSTER_QOS:
		return o->qos;
	case CLUSTER_TIME:
		return o->time > 0;
	case CLUSTER_TASK_SECONDS:
		return o->task_seconds > 0 || o->task_points;
	case CLUSTER_TASK_MEMORY:
		return o->task_memory;
	case CLUSTER_MAX_TASKS:
		return o->max_tasks;
	case CLUSTER_ATTEMPTS:
		return o->attempts;
	case CLUSTER_SCRATCH:
		return o->scratch;
	case CLUSTER_SBATCH:
	case CLUSTER_SETTINGS:
		break;
	}
	return false; /* options of sbatch add up */
}

static void add_setting(struct list *l, size_t id, const char *text)
{
	char head[40], *copy, *save = NULL;

	if (id != CLUSTER_SBATCH) {
		snprintf(head, sizeof head, "--%s=", id == CLUSTER_SCHEDULER_NAME ? "on" : cluster_setting_name(id));
		add(l, head, text);
		return;
	}
	copy = strdup(text);
	l->failed |= !copy;
	for (char *word = copy ? strtok_r(copy, " \t", &save) : NULL; word; word = strtok_r(NULL, " \t", &save))
		add(l, "--sbatch=", word);
	free(copy);
}

/* The value of --directory is part of the argument, or all of it. */
static bool has_directory(const struct program *p, const char *arg)
{
	const char *value = p->opt.directory;

	return value && value >= arg && value <= arg + strlen(arg);
}

/* Tasks begin in another folder: that of --directory, which is the current one now, is noted by its path. */
static void add_words(struct list *l, const struct program *p, const char *folder)
{
	unsigned input = 0;
	bool ended = false;

	for (int i = 1; i < p->argc; i++) {
		char head[64];

		if (input < p->line.nword && p->line.word[input] == p->argv[i]) {
			input++;
			continue;
		}
		ended = ended || !strcmp(p->argv[i], "--");
		if (!ended && has_directory(p, p->argv[i])) {
			snprintf(head, sizeof head, "%.*s", (int)(p->opt.directory - p->argv[i]), p->argv[i]);
			add(l, head, folder);
		} else if (!ended) {
			add(l, "", p->argv[i]);
		}
	}
	if (!p->opt.directory)
		add(l, "--directory=", folder);
}

int cluster_words(const struct program *p, const struct cluster_settings *s, char ***ret, size_t *ret_n, struct err *err)
{
	char folder[PATH_MAX];
	struct list l = {0};

	if (!getcwd(folder, sizeof folder))
		return err_set(err, ERR_IO, "the current folder has no name");
	add_words(&l, p, folder);
	for (size_t i = 0; i < CLUSTER_SETTINGS; i++)
		if (s->text[i] && !is_given(p, i))
			add_setting(&l, i, s->text[i]);
	if (l.failed) {
		cluster_words_free(l.word);
		return err_set(err, ERR_NOMEM, "no memory for the words of the command");
	}
	*ret = l.word;
	*ret_n = l.n;
	return 0;
}

void cluster_words_free(char **word)
{
	for (char **w = word; w && *w; w++)
		free(*w);
	free(word);
}

/* cli_parse wants argv, with the program, and may change the spelling of values. */
int cluster_words_parse(const char *const *word, size_t n, struct program *ret, struct err *err)
{
	const struct cli cli = cluster_cli();
	char **argv = calloc(n + 2, sizeof *argv);
	int r;

	if (!argv)
		return err_set(err, ERR_NOMEM, "no memory for the words of the command");
	argv[0] = "acut-cluster";
	for (size_t i = 0; i < n; i++)
		argv[i + 1] = (char *)word[i];
	r = cli_parse(&cli, (int)n + 1, argv, ret, &ret->line, err);
	free(argv);
	return r;
}
