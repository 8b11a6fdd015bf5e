/* What every translated program needs: ways out of a body, numbers, and answers. */

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OFF, DONE, FAULT, NEED, ILLEGAL, BLOCKED };
enum { RUNNING, ASKED, STOPPED };

static jmp_buf way_out;
static int unsure;    /* a run left the sizes of this translation: no answer counts */
static int asked;     /* answers given in this run of a body */
static int edge;      /* an integer was tried behind which others may be legal, too */
static int *answers, *given, *wanted;

#define LEAVE(how) longjmp(way_out, (how) + 1)
#define TOO_LARGE() do { unsure = 1; LEAVE(ILLEGAL); } while (0)

/* A statement that faults does not hold. [PROP-FAULT] */
#define HOLDS(result, condition) do { \
    jmp_buf saved; volatile int was_true = 0, how; \
    memcpy(&saved, &way_out, sizeof saved); \
    how = setjmp(way_out); \
    if (how == 0) was_true = (condition); \
    memcpy(&way_out, &saved, sizeof saved); \
    if (how == NEED + 1 || how == ILLEGAL + 1) longjmp(way_out, how); \
    result = was_true; \
  } while (0)

static int small(long long n)
{
  if (n > 1000000000LL || n < -1000000000LL) TOO_LARGE();
  return (int) n;
}
static int add(int a, int b) { return small((long long) a + b); }
static int subtract(int a, int b) { return small((long long) a - b); }
static int multiply(int a, int b) { return small((long long) a * b); }
static int least(int a, int b) { return b < a ? b : a; }
static int greatest(int a, int b) { return a < b ? b : a; }
static int divide(int a, int b)
{
  if (b == 0) LEAVE(FAULT);
  return a / b - (a % b != 0 && (a < 0) != (b < 0));
}
static int modulo(int a, int b) { return a - b * divide(a, b); }
static int within(int i, int size)
{
  if (i < 0 || i >= size) LEAVE(FAULT);
  return i;
}

/* The next answer below `count`: one that Promela has chosen, or it is asked to choose one. */
static int pick(int count)
{
  if (count == 1) return 0;
  if (asked == *given) { *wanted = count; LEAVE(NEED); }
  return answers[asked++];
}
static int choice(int low, int high)
{
  if (high < low) LEAVE(FAULT);
  if (high - low > 20) TOO_LARGE();
  return low + pick(high - low + 1);
}
static int any_int(void)
{
  int n = pick(5) - 1;
  if (n == -1 || n == 3) edge = 1;
  return n;
}
