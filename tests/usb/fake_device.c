/*
 * The stream of the model. Bytes of the source are delivered in packets; where a fault is due, the stream is cut and the fault
 * takes effect. Everything depends only on the bytes sent, the steps counted and the time passed in. So the same script gives the
 * same faults at the same bytes, whatever the size of the host's transfers.
 */
#include <stdlib.h>
#include <string.h>

#include "fake_device.h"

const char *const fake_verb_names[FAKE_VERBS] = {
	"stall",  "short",  "babble",  "error",  "lose", "delay", "duplicate", "garbage",
	"unplug", "silent", "timeout", "refuse", "stop", "kill",  "pause",     "deny",
};
const char *const fake_step_names[FAKE_STEPS] = {
	"byte", "end", "open", "string", "claim", "start", "submit", "reap", "clear", "discard", "release",
};

void fake_device_init(struct fake_device *d)
{
	memset(d, 0, sizeof *d);
	strcpy(d->serial, "1001");
	strcpy(d->manufacturer, "acut");
	strcpy(d->model, "pretended scanner");
	strcpy(d->port, "1-1");
	d->vendor = 0x1209;
	d->product = 0x0001;
	d->packet = 512;
	d->interface_class = 0xff;
	d->endpoint_in = 0x81;
	d->endpoint_out = 0x02;
	d->source = FAKE_PATTERN;
	d->size = 1 << 20;
	fake_hash_init(&d->hash);
}

bool fake_device_open_source(struct fake_device *d)
{
	if (d->source == FAKE_FILE) {
		d->file = fopen(d->path, "rbe");
		if (!d->file) {
			perror(d->path);
			return false;
		}
	}
	if (d->delivered_path[0]) {
		d->delivered_file = fopen(d->delivered_path, "wbe");
		if (!d->delivered_file) {
			perror(d->delivered_path);
			return false;
		}
	}
	d->running = !d->on_command;
	return true;
}

void fake_device_clear(struct fake_device *d)
{
	if (d->file)
		fclose(d->file);
	if (d->delivered_file)
		fclose(d->delivered_file);
	free(d->text);
}

/* ---- the source, in order ---- */

static bool text_next(struct fake_device *d)
{
	if (d->text_sent < d->text_size)
		return true;
	free(d->text);
	d->text = NULL;
	d->text_size = d->text_sent = 0;
	if (d->telegrams >= d->size)
		return false;
	d->text = fake_cola_telegram(d, d->telegrams, &d->text_size);
	if (!d->text)
		abort();
	d->telegrams++;
	return true;
}

/* At most n bytes; fewer only at its end. COLA: never over the end of a telegram. */
static size_t source_take(struct fake_device *d, uint8_t *at, size_t n)
{
	size_t got = 0;

	if (d->source == FAKE_COLA) {
		if (!text_next(d))
			return 0;
		got = d->text_size - d->text_sent < n ? d->text_size - d->text_sent : n;
		memcpy(at, d->text + d->text_sent, got);
		d->text_sent += got;
	} else if (d->source == FAKE_FILE) {
		got = fread(at, 1, n, d->file);
	} else {
		for (; got < n && d->made + got < d->size; got++) { /* a counter in each 8 bytes, the seed above it */
			uint64_t place = d->made + got, word = (place / 8) ^ (d->seed << 40);

			at[got] = (uint8_t)(word >> (place % 8 * 8));
		}
	}
	d->made += got;
	return got;
}

static uint64_t source_drop(struct fake_device *d, uint64_t n)
{
	uint8_t none[4096];
	uint64_t gone = 0;

	while (gone < n) {
		size_t got = source_take(d, none, n - gone < sizeof none ? (size_t)(n - gone) : sizeof none);

		if (got == 0)
			break;
		gone += got;
	}
	d->lost += gone;
	return gone;
}

/* Bytes until the next end of a message; 0: there are none. */
static uint64_t message_left(struct fake_device *d)
{
	if (d->source == FAKE_COLA)
		return text_next(d) ? d->text_size - d->text_sent : 0;
	return d->message ? d->message - d->made % d->message : 0;
}

static bool source_ended(struct fake_device *d)
{
	int c;

	if (d->source == FAKE_COLA)
		return !text_next(d);
	if (d->source == FAKE_PATTERN)
		return d->made >= d->size;
	c = fgetc(d->file);
	if (c != EOF)
		ungetc(c, d->file);
	return c == EOF;
}

/* ---- records of what was delivered ---- */

static void row_add(struct fake_device *d, enum fake_verb verb, uint64_t lost, uint64_t added)
{
	if (d->n_rows == FAKE_ROWS) {
		d->rows_missed++;
		return;
	}
	d->rows[d->n_rows++] = (struct fake_row){verb, d->delivered, d->made, lost, added};
}

static void delivered_add(struct fake_device *d, const uint8_t *at, size_t n)
{
	size_t keep = n < sizeof d->last ? n : sizeof d->last, old;

	fake_hash_add(&d->hash, at, n);
	if (d->delivered_file)
		fwrite(at, 1, n, d->delivered_file);
	d->delivered += n;
	old = sizeof d->last - keep;
	if (old > d->last_size)
		old = d->last_size;
	memmove(d->last, d->last + d->last_size - old, old);
	memcpy(d->last + old, at + n - keep, keep);
	d->last_size = old + keep;
}

/* ---- faults ---- */

static void source_lose(struct fake_device *d, const struct fake_fault *f)
{
	uint64_t delivered = d->delivered, source = d->made, lost = source_drop(d, f->amount);

	row_add(d, f->verb, lost, 0);
	if (!d->rows_missed) {
		d->rows[d->n_rows - 1].delivered = delivered;
		d->rows[d->n_rows - 1].source = source;
	}
}

static bool fault_due(const struct fake_device *d, const struct fake_fault *f)
{
	if (f->step == FAKE_AT_BYTE)
		return f->every ? d->made >= (f->fired + 1) * f->every : !f->fired && d->made >= f->at;
	return false;
}

/* Bytes of the source until the next fault. */
static uint64_t fault_left(const struct fake_device *d)
{
	uint64_t left = UINT64_MAX;

	for (size_t i = 0; i < d->n_faults; i++) {
		const struct fake_fault *f = &d->faults[i];
		uint64_t at = f->every ? (f->fired + 1) * f->every : f->at;

		if (f->step == FAKE_AT_BYTE && (f->every || !f->fired) && at > d->made && at - d->made < left)
			left = at - d->made;
	}
	return left;
}

static void go_away(struct fake_device *d, const struct fake_fault *f, int64_t now_ns)
{
	d->gone = true;
	d->gone_ns = now_ns;
	d->gone_for_ns = f->span_ns;
	row_add(d, FAKE_UNPLUG, 0, 0);
}

/* Faults that only change the state and move no bytes. True: it was one of them. */
static bool fault_state(struct fake_device *d, const struct fake_fault *f, int64_t now_ns)
{
	switch (f->verb) {
	case FAKE_STALL:
		d->halted = true;
		return true;
	case FAKE_SHORT:
		d->in_short = true;
		d->short_left = f->amount;
		return true;
	case FAKE_DELAY:
		d->not_before_ns = now_ns + f->span_ns;
		return true;
	case FAKE_UNPLUG:
		go_away(d, f, now_ns);
		return true;
	case FAKE_SILENT:
		d->silent = true;
		return true;
	case FAKE_TIMEOUT:
		d->deaf = true;
		return true;
	case FAKE_REFUSE:
		d->refusing = true;
		return true;
	case FAKE_STOP:
		d->wants_stop = true;
		return true;
	case FAKE_KILL:
		d->wants_kill = true;
		return true;
	case FAKE_DENY:
		d->denies = true;
		return true;
	case FAKE_PAUSE:
		d->wants_pause_ns = f->span_ns;
		return true;
	default:
		return false;
	}
}

/* Adds bytes of the device's own, as many as there is room for. */
static void fault_bytes(struct fake_device *d, const struct fake_fault *f, uint8_t *at, size_t room, struct fake_in *ret)
{
	size_t n = f->amount < room ? (size_t)f->amount : room;

	if (f->verb == FAKE_DUPLICATE) {
		if (n > d->last_size)
			n = d->last_size;
		memcpy(at, d->last + d->last_size - n, n);
	} else {
		uint64_t x = d->made * 0x9e3779b97f4a7c15u + d->seed + 1;

		for (size_t i = 0; i < n; i++) {
			x ^= x << 13;
			x ^= x >> 7;
			x ^= x << 17;
			at[i] = i % 97 == 3 ? 2 : i % 89 == 5 ? 3 : (uint8_t)(x >> 32);
		}
	}
	row_add(d, f->verb, 0, n);
	d->added += n;
	delivered_add(d, at, n);
	ret->kind = FAKE_BYTES;
	ret->size = n;
	ret->ends = n % d->packet != 0;
}

enum due { DUE_NOTHING, DUE_STATE, DUE_BYTES };

/* BYTES: the result is in `ret`. STATE: the state has changed; more faults may be due. */
static enum due fault_next(struct fake_device *d, int64_t now_ns, uint8_t *at, size_t room, struct fake_in *ret)
{
	for (size_t i = 0; i < d->n_faults; i++) {
		struct fake_fault *f = &d->faults[i];

		if (!fault_due(d, f))
			continue;
		f->fired++;
		if (fault_state(d, f, now_ns))
			return DUE_STATE;
		if (f->verb == FAKE_DUPLICATE || f->verb == FAKE_GARBAGE) {
			fault_bytes(d, f, at, room, ret);
			return ret->size > 0 ? DUE_BYTES : DUE_STATE;
		}
		source_lose(d, f);
		if (f->verb == FAKE_LOSE)
			return DUE_STATE;
		ret->kind = f->verb == FAKE_BABBLE ? FAKE_OVERFLOW : FAKE_BROKEN;
		return DUE_BYTES;
	}
	return DUE_NOTHING;
}

void fake_device_step(struct fake_device *d, enum fake_step step, int64_t now_ns)
{
	d->steps[step]++;
	for (size_t i = 0; i < d->n_faults; i++) {
		struct fake_fault *f = &d->faults[i];

		if (f->step != step || f->fired || d->steps[step] < f->at)
			continue;
		f->fired++;
		if (!fault_state(d, f, now_ns) && f->verb == FAKE_LOSE)
			source_lose(d, f);
	}
}

/* ---- the stream ---- */

static void stream_wait(struct fake_in *ret, int64_t when_ns)
{
	ret->kind = FAKE_WAIT;
	ret->when_ns = when_ns;
}

/* With a rate: how many bytes have been made and not sent; drops those that exceed the buffer. */
static uint64_t rate_ready(struct fake_device *d, int64_t now_ns, int64_t *ret_when)
{
	double per_s = d->rate;
	uint64_t due, ready;

	if (d->source == FAKE_COLA && text_next(d))
		per_s *= (double)d->text_size;
	if (!d->began_ns) {
		d->began_ns = now_ns;
		d->sent_stream = 0;
	}
	due = (uint64_t)((double)(now_ns - d->began_ns) * 1e-9 * per_s);
	ready = due > d->sent_stream ? due - d->sent_stream : 0;
	if (d->buffer && ready > d->buffer) {
		uint64_t over = (ready - d->buffer + d->packet - 1) / d->packet * d->packet, gone;

		row_add(d, FAKE_LOSE, over, 0);
		gone = source_drop(d, over);
		d->sent_stream += gone;
		ready -= gone < ready ? gone : ready;
	}
	*ret_when = now_ns + (int64_t)((double)d->packet / per_s * 1e9) + 1;
	return ready;
}

/* How many bytes may go now, and whether the last of them ends a packet early. */
static size_t stream_room(struct fake_device *d, int64_t now_ns, size_t room, bool *ret_ends, int64_t *ret_when)
{
	uint64_t n = room, left = message_left(d), due = fault_left(d), ready;
	bool cut = false;

	*ret_when = FAKE_NEVER;
	if (left && left <= n)
		n = left, cut = true;
	if (due < n)
		n = due, cut = due % d->packet != 0;
	if (d->in_short && d->short_left <= n)
		n = d->short_left, cut = true;
	if (d->rate > 0) {
		ready = rate_ready(d, now_ns, ret_when);
		if (ready < n) { /* whole packets only, but the last one */
			n = ready / d->packet * d->packet;
			cut = false;
		}
	}
	*ret_ends = cut;
	return (size_t)n;
}

static void stream_next(struct fake_device *d, int64_t now_ns, uint8_t *at, size_t room, struct fake_in *ret)
{
	int64_t when;
	bool ends, was_short = d->in_short;
	size_t n = stream_room(d, now_ns, room, &ends, &when);

	if (n == 0 && !(was_short && d->short_left == 0)) {
		stream_wait(ret, when);
		return;
	}
	ret->kind = FAKE_BYTES;
	ret->size = n ? source_take(d, at, n) : 0;
	ret->ends = ends;
	if (ret->size < n || source_ended(d))
		ret->ends = true;
	d->sent_stream += ret->size;
	if (was_short) {
		d->short_left -= ret->size < d->short_left ? ret->size : d->short_left;
		if (d->short_left == 0)
			d->in_short = false;
	}
	delivered_add(d, at, ret->size);
}

void fake_device_in(struct fake_device *d, int64_t now_ns, uint8_t *at, size_t room, struct fake_in *ret)
{
	*ret = (struct fake_in){.kind = FAKE_WAIT, .when_ns = FAKE_NEVER};
	if (d->gone) {
		ret->kind = FAKE_GONE;
		return;
	}
	if (d->answer_sent < d->answer_size && !d->halted && d->text_sent == 0) {
		size_t n = d->answer_size - d->answer_sent;

		ret->kind = FAKE_BYTES;
		ret->size = n < room ? n : room;
		memcpy(at, d->answer + d->answer_sent, ret->size);
		delivered_add(d, at, ret->size);
		d->answer_sent += ret->size;
		d->added += ret->size;
		ret->ends = d->answer_sent == d->answer_size;
		return;
	}
	if (d->halted) {
		ret->kind = FAKE_HALT;
		return;
	}
	if (now_ns < d->not_before_ns) {
		stream_wait(ret, d->not_before_ns);
		return;
	}
	if (d->silent || (!d->running && !(d->source == FAKE_COLA && d->text_sent > 0)))
		return;
	if (source_ended(d)) {
		if (!d->ended) {
			d->ended = true;
			fake_device_step(d, FAKE_AT_END, now_ns);
			if (d->gone)
				ret->kind = FAKE_GONE;
		}
		return;
	}
	for (enum due due = DUE_STATE; due != DUE_NOTHING && !d->in_short;) {
		due = fault_next(d, now_ns, at, room, ret);
		if (due == DUE_BYTES)
			return;
		if (d->gone)
			ret->kind = FAKE_GONE;
		else if (d->halted)
			ret->kind = FAKE_HALT;
		else if (now_ns < d->not_before_ns)
			stream_wait(ret, d->not_before_ns);
		if (d->gone || d->halted || d->silent || now_ns < d->not_before_ns || source_ended(d))
			return;
	}
	stream_next(d, now_ns, at, room, ret);
}

enum fake_out fake_device_out(struct fake_device *d, int64_t now_ns, const uint8_t *at, size_t size)
{
	(void)now_ns;
	if (d->refusing)
		return FAKE_OUT_HALT;
	if (d->deaf)
		return FAKE_OUT_WAIT;
	d->commands++;
	if (d->source == FAKE_COLA)
		fake_cola_command(d, at, size);
	else
		d->running = true;
	return FAKE_TAKEN;
}

void fake_device_clear_halt(struct fake_device *d, uint8_t endpoint)
{
	if (endpoint == d->endpoint_in)
		d->halted = false;
	else if (endpoint == d->endpoint_out)
		d->refusing = false;
}

void fake_device_plug(struct fake_device *d)
{
	d->gone = d->halted = d->refusing = d->deaf = false;
	d->running = !d->on_command;
	d->answer_size = d->answer_sent = 0;
	d->began_ns = 0;
	d->in_short = false;
	if (d->text_sent > 0) { /* the telegram that was being sent ends here */
		uint64_t rest = d->text_size - d->text_sent;

		row_add(d, FAKE_UNPLUG, rest, 0);
		d->lost += rest;
		d->made += rest;
		d->text_sent = d->text_size;
	}
}

void fake_report(FILE *f, const struct fake_device *d)
{
	char sum[65];

	fake_hash_text(&d->hash, sum);
	fprintf(f,
		"{\"name\": \"%s\", \"serial\": \"%s\", \"delivered\": %llu, \"made\": %llu, \"lost\": %llu, \"added\": %llu, \"sha256\": \"%s\"",
		d->name, d->serial, (unsigned long long)d->delivered, (unsigned long long)d->made, (unsigned long long)d->lost,
		(unsigned long long)d->added, sum);
	fprintf(f, ", \"commands\": %llu, \"answers\": %llu, \"telegrams\": %llu, \"ended\": %s, \"faults\": [",
		(unsigned long long)d->commands, (unsigned long long)d->answers, (unsigned long long)d->telegrams,
		d->ended ? "true" : "false");
	for (size_t i = 0; i < d->n_faults; i++)
		fprintf(f, "%s{\"verb\": \"%s\", \"fired\": %llu}", i ? ", " : "", fake_verb_names[d->faults[i].verb],
			(unsigned long long)d->faults[i].fired);
	fputs("], \"rows\": [", f);
	for (size_t i = 0; i < d->n_rows; i++)
		fprintf(f, "%s{\"verb\": \"%s\", \"delivered\": %llu, \"source\": %llu, \"lost\": %llu, \"added\": %llu}",
			i ? ", " : "", fake_verb_names[d->rows[i].verb], (unsigned long long)d->rows[i].delivered,
			(unsigned long long)d->rows[i].source, (unsigned long long)d->rows[i].lost,
			(unsigned long long)d->rows[i].added);
	fputs("], \"steps\": {", f);
	for (int i = FAKE_AT_OPEN; i < FAKE_STEPS; i++)
		fprintf(f, "%s\"%s\": %llu", i > FAKE_AT_OPEN ? ", " : "", fake_step_names[i], (unsigned long long)d->steps[i]);
	fputs("}}", f);
}
