/* Lists of rows: thousands of short lines, which go out together and not each at once. */
#include "ctl.h"

void ctl_list_begin(struct ctl *ctl)
{
	static char together[128 << 10];

	/* Before anything was written to it. */
	setvbuf(ctl->report, together, _IOFBF, sizeof together);
	ctl->list = true;
}
