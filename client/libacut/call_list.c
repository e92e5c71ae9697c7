/*
 * Lists, which come in pages. Their keys must rise from row to row, so that a daemon at fault cannot keep a list going
 * for ever. The daemon makes the next page while this one is handed out.
 */
#include "call.h"

static int list_ask(struct acut *a, const struct call_list *l, uint32_t *ret_id)
{
	int r = call_send(a, l->req, -1, ret_id);

	/* Sent now; an error of the connection is met by the wait for the answer. */
	if (r == 0)
		frame_conn_flush(a->conn, &a->err);
	return r;
}

int call_list(struct acut *a, const struct call_list *l)
{
	Acut__V1__Message *last = NULL, *page; /* last: may hold the keys of rows handed out */
	bool more = true;
	uint32_t id;
	int r = list_ask(a, l, &id);

	while (r == 0 && more) {
		r = call_next(a, id, &page, NULL);
		if (r < 0)
			break;
		if (page->body_case != l->want) {
			r = call_unexpected(a, page);
			frame_message_free(page);
			break;
		}
		more = l->next(l->ctx, page);
		if (more && !l->asks)
			r = list_ask(a, l, &id);
		if (r == 0)
			r = l->rows(l->ctx, page);
		if (r == 0 && more && l->asks)
			r = list_ask(a, l, &id);
		frame_message_free(last);
		last = page;
	}
	frame_message_free(last);
	return r;
}

int call_rises(struct acut *a, bool rises, const char *what)
{
	return rises ? 0 : err_set(&a->err, ERR_PROTO, "the daemon's list of %s does not rise", what);
}
