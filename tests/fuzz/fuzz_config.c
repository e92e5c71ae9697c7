/* Any bytes as acutd.conf: errors have a place and a sentence, and a value that is taken is told as one that is taken again. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config.h"
#include "config_file.h"
#include "config_report.h"
#include "fuzz_input.h"

static const char *const texts[] = {
	"",
	"# a comment\nmemory = 4G\nthreads=2\r\n  disk = 70%  \n",
	"state = \"/srv/a b\"\ncache = '/c'\nsocket=/run/s\n",
	"group = acut\nadmin-group = 0\nuser-jobs = 3\nuser-memory = 25%\nuser-disk = 50G\nuser-connections = 4\n",
	"keep-free = 0%\nkeep-removed = 7d\nspace-wait = 1.5m\nlog-level = debug\nkeep-free =\n",
	"memroy = 1\n[x]\ndisk\ndisk = 1 # a\n",
	"\xef\xbb\xbfthreads = 256\nthreads = 257\n",
	"init = yes\nstate = data\ndisk = 1\\\n",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

static void tell(void *ctx, bool warning, const struct err *err)
{
	if (err->code != ERR_USAGE || strncmp(err->file, "/f:", 3) || !*err->message)
		abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct config_report report = {.emit = tell};
	struct config c, again;
	char *text = malloc(size + 1), value[CONFIG_PATH_SIZE];
	const char *wanted;

	if (!text)
		abort();
	memcpy(text, bytes, size);
	config_presets(&c);
	config_text("/f", text, size, &c, &report);
	if (report.errors)
		tell(NULL, false, &report.first);
	config_presets(&again);
	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		const struct config_setting *s = &config_settings[i];

		if (c.origin[i].by != CONFIG_BY_FILE)
			continue;
		if (s->scope == CONFIG_LINE || !c.origin[i].line || strcmp(c.origin[i].file, "/f"))
			abort();
		config_value_text(s, &c, value);
		if (!config_value_parse(s, value, &again, &wanted) || !config_value_equal(s, &c, &again))
			abort();
	}
	free(text);
	return 0;
}
