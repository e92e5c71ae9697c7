/*
 * HTML: one page that shows the mesh in a browser and needs nothing else. The page itself is the room client/page; what it has of
 * the mesh is exact (docs/design/page.md).
 *
 * Vertices are written in place, triangles to an annex, both as lines that need no other line. Counts, digests and all that other
 * formats have in comments stand behind them, where they are known: nothing is patched. A browser keeps the mesh in memory, so
 * larger ones are refused.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_axis.h"
#include "format_domain.h"
#include "format_html.h"
#include "format_text.h"
#include "outfile.h"
#include "page.h"

struct html {
	struct outfile *out, *faces;
	struct format_options opt;
	struct page_pack *pack;
	char *facts; /* JSON, without its end */
	char name[300];
	uint64_t nvertex, nface;
};

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for a writer");
}

static int html_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct html *h = calloc(1, sizeof(*h));

	if (!h)
		return no_memory(err);
	h->out = out;
	h->opt = *opt;
	format_file_name(out, "mesh", h->name, sizeof(h->name));
	*ret = h;
	return 0;
}

/* ---- facts: what the page knows of the mesh beside its data ---- */

/* Whole numbers of any size: coordinate = (number * a + b) / q. */
static void put_axis(FILE *f, const struct format_axis *ax)
{
	int e = ax->converted ? 0 : ax->whole ? ax->e : ax->scale.exponent;

	fputc('{', f);
	if (ax->converted) {
		page_put_whole(f, "a", ax->value.a, 0);
		page_put_whole(f, "b", ax->value.b, 0);
		page_put_whole(f, "q", ax->value.q, 0);
	} else {
		page_put_whole(f, "a", ax->whole ? ax->a : ax->scale.mantissa, e);
		page_put_whole(f, "b", ax->whole ? ax->b : (__int128)ax->k * ax->scale.mantissa, e);
		page_put_whole(f, "q", 1, -e);
	}
	fprintf(f, "\"decimals\":%d}", ax->converted ? ax->decimals : e < 0 ? -e : 0);
}

static int put_fact(void *ctx, const char *text, struct err *err)
{
	size_t n = strcspn(text, " ");
	char value[FORMAT_TEXT_GROWTH * FORMAT_COMMENT];

	format_text(FORMAT_TEXT_JSON, text[n] ? text + n + 1 : "", value, sizeof(value));
	fprintf(ctx, "\"%.*s\":\"%s\",", (int)n, text, value);
	return 0;
}

int format_html_facts(const char *name, const struct acut_mesh_head *head, const struct format_options *opt, char **ret,
		      struct err *err)
{
	char text[FORMAT_TEXT_GROWTH * sizeof(((struct html *)0)->name)];
	struct format_axis axis[3];
	size_t size = 0;
	int r = format_axis_init(axis, head, opt, err);
	FILE *f = r ? NULL : open_memstream(ret, &size);

	if (!f)
		return r ? r : no_memory(err);
	fprintf(f, "{\"format\":1,\"name\":\"%s\",\"axes\":[", format_text(FORMAT_TEXT_JSON, name, text, sizeof(text)));
	for (int i = 0; i < 3; i++) {
		fputs(i ? "," : "", f);
		put_axis(f, &axis[i]);
	}
	fputs("],\"comments\":{", f);
	format_comment_head(head, opt, put_fact, f, err);
	return fclose(f) ? no_memory(err) : 0;
}

/* No end of a script is in a text. */
int format_html_put_facts(struct outfile *out, const char *facts, const char *more, const struct acut_mesh_tail *tail,
			  const uint64_t counts[2], struct err *err)
{
	char end[200];
	int r = 0;

	for (const char *at = facts, *next; *at && !r; at = next) {
		size_t n = strcspn(at, "<");

		next = at + n + (at[n] == '<');
		r = outfile_write(out, at, n, err);
		if (!r && at[n])
			r = outfile_write(out, "\\u003c", 6, err);
	}
	snprintf(end, sizeof(end), "\"acut-digest\":\"%s %s\"},", tail->digest, tail->vertex_digest);
	if (!r)
		r = outfile_write(out, end, strlen(end), err);
	if (!r)
		r = outfile_write(out, more, strlen(more), err);
	snprintf(end, sizeof(end), "\"vertices\":%" PRIu64 ",\"triangles\":%" PRIu64 "}", counts[0], counts[1]);
	return r ? r : outfile_write(out, end, strlen(end), err);
}

static int html_begin(struct html *h, const struct acut_mesh_head *head, struct err *err)
{
	int r = format_html_facts(h->name, head, &h->opt, &h->facts, err);

	return r ? r : page_pack_new(&h->pack, err);
}

int format_html_title(struct outfile *out, const char *sources, const char *name, struct err *err)
{
	char title[FORMAT_TEXT_GROWTH * sizeof(((struct html *)0)->name)];
	int r = page_put(out, PAGE_UP_TO_SOURCES, err);

	format_text(FORMAT_TEXT_XML, name, title, sizeof(title));
	if (!r)
		r = outfile_write(out, sources, strlen(sources), err);
	if (!r)
		r = page_put(out, PAGE_UP_TO_TITLE, err);
	if (!r)
		r = outfile_write(out, title, strlen(title), err);
	return r ? r : page_put(out, PAGE_UP_TO_VERTICES, err);
}

/* ---- the file ---- */

static int html_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct html *h = writer;
	int r = html_begin(h, head, err);

	if (!r)
		r = format_html_title(h->out, "", h->name, err);
	return r ? r : outfile_annex(h->out, &h->faces, err);
}

static void html_save(const void *writer, struct packer *to)
{
	const struct html *h = writer;

	packer_u64(to, h->nvertex);
	packer_u64(to, h->nface);
}

static int html_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct html *h = writer;
	int r = html_begin(h, head, err);

	h->nvertex = cursor_u64(from);
	h->nface = cursor_u64(from);
	return r ? r : outfile_annex(h->out, &h->faces, err);
}

static int html_block(void *writer, const struct format_block *block, struct err *err)
{
	struct html *h = writer;
	const struct acut_mesh_block *b = block->mesh;
	bool vertices = h->nvertex + b->nnew > PAGE_TRIANGLES;
	int r;

	if (vertices || h->nface + b->ntriangle > PAGE_TRIANGLES) {
		err_set(err, ERR_LIMIT, "a page holds %u %s at most, and the mesh has more", PAGE_TRIANGLES,
			vertices ? "vertices" : "triangles");
		return err_add_hint(err, "write a folder with levels of detail, --levels -o DIR/; many pages, --tile SIDE "
					 "--format html -o DIR/; or a part of the mesh, --bbox X1,Y1,X2,Y2");
	}
	r = page_pack_vertices(h->pack, h->out, b->vertex, b->nnew, err);
	if (!r)
		r = page_pack_faces(h->pack, h->faces, b, format_domain(b->box), err);
	h->nvertex += b->nnew;
	h->nface += b->ntriangle;
	return r;
}

static int html_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct html *h = writer;
	int r = page_put(h->out, PAGE_UP_TO_FACES, err);

	if (!r)
		r = outfile_pad(h->out, h->faces, ' ', err);
	if (!r)
		r = outfile_join(h->out, h->faces, 0, err);
	if (!r)
		r = page_put(h->out, PAGE_UP_TO_FACTS, err);
	if (!r)
		r = format_html_put_facts(h->out, h->facts, "", tail, (uint64_t[]){h->nvertex, h->nface}, err);
	return r ? r : page_put(h->out, PAGE_UP_TO_END, err);
}

static void *html_free(void *writer)
{
	struct html *h = writer;

	if (!h)
		return NULL;
	outfile_free(h->faces);
	page_pack_free(h->pack);
	free(h->facts);
	free(h);
	return NULL;
}

const struct format format_html = {
	.name = "html",
	.extensions = ".html .htm",
	.help = "a page that shows the mesh, without a network; more than 2 million triangles with --levels",
	.purpose = "any browser, telephones too",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT,
	.open = html_open,
	.head = html_head,
	.block = html_block,
	.finish = html_finish,
	.free = html_free,
	.save = html_save,
	.resume = html_resume,
};
