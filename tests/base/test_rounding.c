/*
 * Products are rounded before they are added (-ffp-contract=off): arm64 has an instruction that does not, and compilers use it
 * without being asked. The same sources would then give other bytes on another machine.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

__attribute__((noinline)) static double product_and_sum(double a, double b, double c)
{
	return a * b + c;
}

__attribute__((noinline)) static double difference_of_products(double a, double b, double c, double d)
{
	return a * b - c * d;
}

static void test_products(void **state)
{
	/* (1 + 2^-30)^2 is 1 + 2^-29 + 2^-60, which a double does not hold. */
	volatile double a = 1 + 0x1p-30, c = 1 + 0x1p-29;

	assert_true(product_and_sum(a, a, -c) == 0);
	assert_true(difference_of_products(a, a, a, a) == 0);
	assert_true(__builtin_fma(a, a, -c) == 0x1p-60);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_products)};

	return cmocka_run_group_tests_name("rounding", tests, NULL, NULL);
}
