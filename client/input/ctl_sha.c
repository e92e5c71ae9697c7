/*
 * SHA-256 by libcrypto (ctl_sha.h).
 *
 * The model: the library that acutctl was built with is opened by its name at the first sum, and stays. Its headers say which
 * functions it has; they are looked up by name, all or none.
 */
#include "ctl_sha.h"

#include <dlfcn.h>
#include <openssl/evp.h>
#include <openssl/opensslv.h>
#include <stdlib.h>

#include "err.h"

#define NUMBER_TEXT(number) #number
#define LIBRARY(number) "libcrypto.so." NUMBER_TEXT(number)

struct ctl_sha {
	EVP_MD_CTX *md;
};

static struct {
	__typeof__(EVP_MD_CTX_new) *ctx_new;
	__typeof__(EVP_MD_CTX_free) *ctx_free;
	__typeof__(EVP_sha256) *sha256;
	__typeof__(EVP_DigestInit_ex) *begin;
	__typeof__(EVP_DigestUpdate) *add;
	__typeof__(EVP_DigestFinal_ex) *end;
} crypto;

static int find(void *library, const char *name, void *to)
{
	void *at = dlsym(library, name);

	*(void **)to = at;
	return at ? 0 : -1;
}

static int load(struct err *err)
{
	void *library;

	if (crypto.ctx_new)
		return 0;
	library = dlopen(LIBRARY(OPENSSL_SHLIB_VERSION), RTLD_NOW | RTLD_LOCAL);
	if (!library || find(library, "EVP_MD_CTX_free", &crypto.ctx_free) || find(library, "EVP_sha256", &crypto.sha256) ||
	    find(library, "EVP_DigestInit_ex", &crypto.begin) || find(library, "EVP_DigestUpdate", &crypto.add) ||
	    find(library, "EVP_DigestFinal_ex", &crypto.end) || find(library, "EVP_MD_CTX_new", &crypto.ctx_new)) {
		err_set(err, ERR_UNSUPPORTED, "there is no SHA-256 here: %s", dlerror());
		return err_add_hint(err,
				    "install OpenSSL's libcrypto, or verify the files with sha256sum and leave --manifest out");
	}
	return 0;
}

struct ctl_sha *ctl_sha_new(struct err *err)
{
	struct ctl_sha *s;

	if (load(err))
		return NULL;
	s = calloc(1, sizeof(*s));
	if (s && (s->md = crypto.ctx_new()) && crypto.begin(s->md, crypto.sha256(), NULL) == 1)
		return s;
	err_set(err, ERR_NOMEM, "no memory to add up a file");
	return ctl_sha_free(s);
}

int ctl_sha_add(struct ctl_sha *s, const void *data, size_t n)
{
	return crypto.add(s->md, data, n) == 1 ? 0 : -1;
}

int ctl_sha_sum(struct ctl_sha *s, unsigned char ret[CTL_SHA_SIZE])
{
	return crypto.end(s->md, ret, NULL) == 1 ? 0 : -1;
}

struct ctl_sha *ctl_sha_free(struct ctl_sha *s)
{
	if (s && s->md)
		crypto.ctx_free(s->md);
	free(s);
	return NULL;
}
