/*
 * Scripts: the devices, their streams and their faults, one statement a line; `#` begins a comment.
 *
 *   device NAME                        begins a device
 *   serial|manufacturer|model|port TEXT
 *   id 19a2:5001                       vendor and product
 *   class 255 [0]                      of the interface, of the device; 8 is mass storage
 *   packet 64                          bytes; 512
 *   locked                             nobody may open its node
 *   busy   driver NAME                 another program, or a driver of the kernel, has its interface
 *   unheard                            udev does not announce it
 *   appear 0.5 s | with PATH           is plugged in after this time, or once this file exists
 *   after-close                        comes back only after the program has closed its node
 *   source pattern 5 MB | file PATH | cola 1000
 *   delivered PATH                     a file that gets the delivered bytes, too
 *   seed N   message BYTES   on-command
 *   rate 2 MB                          per second; of cola: telegrams
 *   buffer 64 KB                       with a rate: what exceeds it is dropped
 *   kernel mock|real   poll file|fifo  caps-off N
 *   at PLACE VERB [AMOUNT]             PLACE: 3 MB | end | step NAME [N]; amounts are bytes or seconds
 *   every 1 MB VERB [AMOUNT]
 *
 * KB and MB are 1024 and 1024 * 1024.
 */
#include <stdlib.h>
#include <string.h>

#include "fake_device.h"

struct words {
	char *at[16];
	size_t n, i;
};

static const char *word_next(struct words *w)
{
	return w->i < w->n ? w->at[w->i++] : NULL;
}

static bool number_next(struct words *w, double *ret)
{
	const char *text = word_next(w);
	char *end;
	double v;

	if (!text)
		return false;
	v = strtod(text, &end);
	if (*end || end == text)
		return false;
	if (w->i < w->n) {
		const char *unit = w->at[w->i];
		double by = strcmp(unit, "KB") == 0                          ? 1024 :
			    strcmp(unit, "MB") == 0                          ? 1024 * 1024 :
			    strcmp(unit, "B") == 0 || strcmp(unit, "s") == 0 ? 1 :
			    strcmp(unit, "ms") == 0                          ? 1e-3 :
									       0;

		if (by > 0) {
			v *= by;
			w->i++;
		}
	}
	*ret = v;
	return true;
}

static bool fault_read(struct fake_device *d, struct words *w, bool every)
{
	struct fake_fault f = {.amount = 512};
	const char *word;
	double v;

	if (d->n_faults == FAKE_FAULTS)
		return false;
	if (!every && w->i < w->n && strcmp(w->at[w->i], "end") == 0) {
		f.step = FAKE_AT_END;
		w->i++;
	} else if (!every && w->i < w->n && strcmp(w->at[w->i], "step") == 0) {
		w->i++;
		word = word_next(w);
		for (int i = FAKE_AT_OPEN; word && i < FAKE_STEPS; i++)
			if (strcmp(word, fake_step_names[i]) == 0)
				f.step = (enum fake_step)i;
		if (f.step == FAKE_AT_BYTE)
			return false;
		f.at = 1;
		if (w->i < w->n && w->at[w->i][0] >= '0' && w->at[w->i][0] <= '9')
			f.at = strtoull(w->at[w->i++], NULL, 10);
	} else {
		if (!number_next(w, &v) || (every && v < 1))
			return false;
		f.at = (uint64_t)v;
		f.every = every ? f.at : 0;
	}
	word = word_next(w);
	f.verb = FAKE_VERBS;
	for (int i = 0; word && i < FAKE_VERBS; i++)
		if (strcmp(word, fake_verb_names[i]) == 0)
			f.verb = (enum fake_verb)i;
	if (f.verb == FAKE_VERBS)
		return false;
	if (number_next(w, &v)) {
		f.amount = (uint64_t)v;
		f.span_ns = (int64_t)(v * 1e9);
	}
	d->faults[d->n_faults++] = f;
	return w->i == w->n;
}

static bool source_read(struct fake_device *d, struct words *w)
{
	const char *kind = word_next(w);
	double v = 0;

	if (!kind)
		return false;
	if (strcmp(kind, "file") == 0) {
		const char *path = word_next(w);

		d->source = FAKE_FILE;
		return path && snprintf(d->path, sizeof d->path, "%s", path) < (int)sizeof d->path;
	}
	d->source = strcmp(kind, "cola") == 0 ? FAKE_COLA : FAKE_PATTERN;
	d->on_command = d->source == FAKE_COLA;
	if (d->source == FAKE_PATTERN && strcmp(kind, "pattern") != 0)
		return false;
	if (!number_next(w, &v))
		return false;
	d->size = (uint64_t)v;
	return true;
}

static bool text_read(struct fake_device *d, const char *key, const struct words *w)
{
	struct {
		const char *key;
		char *at;
	} texts[] = {
		{"serial", d->serial}, {"manufacturer", d->manufacturer}, {"model", d->model}, {"port", d->port},
		{"driver", d->driver},
	};

	for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
		if (strcmp(key, texts[i].key) != 0)
			continue;
		texts[i].at[0] = '\0';
		for (size_t k = 1; k < w->n; k++) {
			if (strlen(texts[i].at) + strlen(w->at[k]) + 2 > FAKE_TEXT)
				return false;
			if (k > 1)
				strcat(texts[i].at, " ");
			strcat(texts[i].at, w->at[k]);
		}
		return true;
	}
	return false;
}

static bool switch_read(struct fake_device *d, const char *key, struct words *w)
{
	const char *word;

	if (strcmp(key, "locked") == 0)
		return d->locked = true;
	if (strcmp(key, "busy") == 0)
		return d->busy = true;
	if (strcmp(key, "unheard") == 0)
		return d->unheard = true;
	if (strcmp(key, "after-close") == 0)
		return d->after_close = true;
	if (strcmp(key, "on-command") == 0)
		return d->on_command = true;
	if (strcmp(key, "kernel") == 0) {
		word = word_next(w);
		d->mock = word && strcmp(word, "mock") == 0;
		return word && (d->mock || strcmp(word, "real") == 0);
	}
	if (strcmp(key, "poll") == 0) {
		word = word_next(w);
		d->no_fifo = word && strcmp(word, "file") == 0;
		return word && (d->no_fifo || strcmp(word, "fifo") == 0);
	}
	return text_read(d, key, w);
}

static bool line_read(struct fake_device *d, const char *key, struct words *w)
{
	double v = 0, v2 = 0;
	unsigned vendor, product;
	const char *word;

	if (strcmp(key, "at") == 0 || strcmp(key, "every") == 0)
		return fault_read(d, w, key[0] == 'e');
	if (strcmp(key, "source") == 0)
		return source_read(d, w);
	if (strcmp(key, "delivered") == 0) {
		word = word_next(w);
		return word && snprintf(d->delivered_path, sizeof d->delivered_path, "%s", word) < (int)sizeof d->delivered_path;
	}
	if (strcmp(key, "id") == 0) {
		word = word_next(w);
		if (!word || sscanf(word, "%x:%x", &vendor, &product) != 2)
			return false;
		d->vendor = (uint16_t)vendor;
		d->product = (uint16_t)product;
		return true;
	}
	if (switch_read(d, key, w))
		return true;
	if (strcmp(key, "appear") == 0 && w->i < w->n && strcmp(w->at[w->i], "with") == 0) {
		w->i++;
		word = word_next(w);
		d->away = true;
		return word && snprintf(d->appear_path, sizeof d->appear_path, "%s", word) < (int)sizeof d->appear_path;
	}
	if (!number_next(w, &v))
		return false;
	if (strcmp(key, "class") == 0) {
		d->interface_class = (uint8_t)v;
		if (number_next(w, &v2))
			d->device_class = (uint8_t)v2;
	} else if (strcmp(key, "packet") == 0) {
		d->packet = (uint16_t)v;
	} else if (strcmp(key, "appear") == 0) {
		d->away = true;
		d->appear_ns = (int64_t)(v * 1e9);
	} else if (strcmp(key, "seed") == 0) {
		d->seed = (uint64_t)v;
	} else if (strcmp(key, "message") == 0) {
		d->message = (uint64_t)v;
	} else if (strcmp(key, "rate") == 0) {
		d->rate = d->hz = v;
	} else if (strcmp(key, "buffer") == 0) {
		d->buffer = (uint64_t)v;
	} else if (strcmp(key, "caps-off") == 0) {
		d->caps_off = (uint32_t)v;
	} else {
		return false;
	}
	return true;
}

bool fake_script_read(const char *path, struct fake_device **ret, size_t *ret_n)
{
	FILE *f = fopen(path, "re");
	struct fake_device *devices = calloc(FAKE_DEVICES, sizeof *devices);
	size_t n = 0;
	char line[1024];

	if (!f || !devices) {
		perror(path);
		exit(2);
	}
	for (unsigned number = 1; fgets(line, sizeof line, f); number++) {
		struct words w = {.n = 0};
		const char *key;
		bool good;

		line[strcspn(line, "#\n")] = '\0';
		for (char *p = strtok(line, " \t"); p && w.n < 16; p = strtok(NULL, " \t"))
			w.at[w.n++] = p;
		key = word_next(&w);
		if (!key)
			continue;
		if (strcmp(key, "device") == 0) {
			good = n < FAKE_DEVICES && w.n == 2;
			if (good) {
				fake_device_init(&devices[n]);
				snprintf(devices[n++].name, FAKE_TEXT, "%s", w.at[1]);
			}
		} else {
			good = n > 0 && line_read(&devices[n - 1], key, &w);
		}
		if (!good) {
			fprintf(stderr, "%s:%u: what is \"%s\" here?\n", path, number, key);
			fclose(f);
			free(devices);
			return false;
		}
	}
	fclose(f);
	*ret = devices;
	*ret_n = n;
	return n > 0;
}
