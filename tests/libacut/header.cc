// acut.h alone, from C++, with the shared library.
#include "acut.h"

int main()
{
	acut *connection = nullptr;
	int r = acut_connect("/nonexistent/acutd.sock", nullptr, &connection);
	int good = r == -ACUT_E_NODAEMON && acut_error(connection)->exit_status == 69;

	acut_close(connection);
	return good ? 0 : 1;
}
