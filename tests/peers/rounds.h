/* Turns and rounds on struct System: what the rules fix once Promela has chosen. */

enum { BEGIN, INIT, READY, TURN, EVOLVE };

static struct System work;
static struct Robot before;
static int found[CLAIMS];

static void break_claim(int claim, int round)
{
  if (found[claim] < 0 || round < found[claim]) found[claim] = round;
}

static void tell(void)
{
  int k;
  for (k = 0; k < CLAIMS; k++) printf("claim %d %d\n", k, found[k]);
  printf("unsure %d\n", unsure);
}

static void get_ready(void)
{
  int k;
  for (k = 0; k < CLAIMS; k++) found[k] = -1;
  atexit(tell);
}

static struct Context of_robot(struct System *s, int who)
{
  struct Robot *me = &s->robots[who];
  struct Context made = { s, me, me, &me->copy, &s->store, who, 0, RUNNING };
  return made;
}

static struct Context of_all(struct System *s)
{
  struct Context made = { s, 0, 0, &s->store, &s->store, -1, 0, RUNNING };
  return made;
}

/* [REFRESH], and every turn is prog again. */
static void refresh(struct System *s)
{
  int i;
  for (i = 0; i < ROBOTS; i++) {
    s->robots[i].copy = s->store;
    s->robots[i].moved = 0;
  }
  s->taken = 0;
}

static int all_moved(struct System *s)
{
  int i;
  for (i = 0; i < ROBOTS; i++) if (!s->robots[i].moved) return 0;
  return 1;
}

/* The first turn of a round clears every `ran`, the last ends the program's turns.
   [EVENT-TRANS] [END-EVENT] [END-PROG] */
static void turn_over(struct System *s, int who, int ran, int stop)
{
  int i, first = 1;
  struct Robot *me = &s->robots[who];
  for (i = 0; i < ROBOTS; i++) if (s->robots[i].moved) first = 0;
  if (first) for (i = 0; i < ROBOTS; i++) s->robots[i].ran = 0;
  me->ran = ran;
  me->moved = 1;
  if (stop > me->status) me->status = stop;
  if (!all_moved(s)) return;
  for (i = 0; i < ROBOTS; i++) if (s->robots[i].status == RUNNING) return;
  for (i = 0; i < ROBOTS; i++) s->robots[i].status = STOPPED;
}

static int perform(int step, int who, int event)
{
  struct Context cx;
  int i, held, kind = KIND[who];
  switch (step) {
  case BEGIN:
    cx = of_all(&work);
    begin_store(&cx);
    refresh(&work);
    return DONE;
  case INIT:
    cx = of_robot(&work, who);
    init_of[kind](&cx);
    work.robots[who].status = cx.stop;
    work.robots[who].moved = 1;
    return DONE;
  case READY:
    cx = of_all(&work);
    for (i = 0; i < ASSUMPTIONS; i++) {
      HOLDS(held, assumption_of[i](&cx));
      if (!held) return ILLEGAL;
    }
    refresh(&work);
    return DONE;
  case TURN:
    if (event >= events_of[kind] || work.robots[who].status == STOPPED) return OFF;
    cx = of_robot(&work, who);
    if (!guards_of[kind][event](&cx)) return OFF;
    effects_of[kind][event](&cx);
    if (cx.entered & work.taken) return BLOCKED;
    work.taken |= cx.entered;
    turn_over(&work, who, event + 1, cx.stop);
    return DONE;
  default:
    before = work.robots[who];
    cx = of_robot(&work, who);
    cx.me = &before;
    evolve_of[kind](&cx);
    return DONE;
  }
}

/* A step with the answers chosen so far: NEED asks for one more. */
static int take_step(struct System *s, int step, int who, int event)
{
  int how;
  answers = s->digits;
  given = &s->have;
  wanted = &s->need;
  asked = edge = 0;
  how = setjmp(way_out);
  if (how == 0) {
    work = *s;
    how = 1 + perform(step, who, event);
  }
  how--;
  if (how == NEED) {
    if (s->have < ANSWERS) return NEED;
    unsure = 1;
    how = ILLEGAL;
  }
  if (how == DONE) {
    work.edge |= edge;
    *s = work;
    if (step != INIT && s->edge) unsure = 1;
  }
  if (how == FAULT && edge) unsure = 1;
  memset(s->digits, 0, sizeof s->digits);
  s->have = s->need = 0;
  return how;
}

static void answer(struct System *s, int digit)
{
  s->digits[s->have++] = digit;
  s->need = 0;
}

/* Which properties the configuration breaks. [PROP-INVARIANT] [PROP-ROUND] [PROP-FAULT] */
static void look(struct System *s, int at_round)
{
  struct Context cx = of_all(s);
  volatile int k, held;
  for (k = 0; k < PROPERTIES; k++) {
    if (AT_ROUND[k] && !at_round) continue;
    held = 0;
    if (setjmp(way_out) == 0) held = property_of[k](&cx);
    if (!held) break_claim(1 + k, s->round);
  }
}

/* A fault in INIT counts if the assumptions hold where evaluation goes on: that is not known here. */
static void fault(struct System *s)
{
  if (s->round == 0 && ASSUMPTIONS > 0) unsure = 1;
  break_claim(0, s->round);
}

/* [SKIP] */
static int may_skip(struct System *s, int who)
{
  struct Context cx = of_robot(s, who);
  volatile int e, kind = KIND[who];
  if (s->robots[who].status == STOPPED) return 1;
  for (e = 0; e < events_of[kind]; e++) {
    if (!urgent_of[kind][e] || (classes_of[kind][e] & s->taken)) continue;
    if (setjmp(way_out) == 0 && guards_of[kind][e](&cx)) return 0;
  }
  return 1;
}

/* The end of the environment's turn, when every robot's ports have evolved. [ENV-TRANS] */
static void round_over(struct System *s)
{
  int k;
  s->outcome = s->faulty ? FAULT : DONE;
  if (s->faulty) { fault(s); return; }
  for (k = 0; 1 + PROPERTIES + k < CLAIMS; k++)
    if (s->broken >> k & 1) break_claim(1 + PROPERTIES + k, s->round);
  s->broken = 0;
  refresh(s);
  look(s, 1);
}

/* SPIN takes no calls for conditions. */
#define ALL_MOVED all_moved(&now.st)
#define MAY_SKIP may_skip(&now.st, now.who)
