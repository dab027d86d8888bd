// SPDX-License-Identifier: Apache-2.0
// Runs of datagrams from and to a socket in one call each, without the interpreter.
//
// A Python thread that asks for each datagram gets the interpreter each time, up to 5 ms late where
// another thread computes. So parts of a message that are exactly those expected are received here
// one after the other, each into its place, acknowledged, and their gaps asked for once; all else
// is handed back at once, whole and in order, and `receiving` judges it by every rule. Nothing is
// kept between two calls, but for credits: while a sender finds room for more, those for what it
// sends are kept here until it looks (`parking.py`), and wake nobody. Where it finds none it may
// leave the rest of a message here, and the thread that receives a credit sends what that makes
// room for.
#define PY_SSIZE_T_CLEAN
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <Python.h>
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>

enum {
    SEQ_NUMBER = 2, PART_NUMBER = 6, PARTS_MAX = 7, TIME = 8, TIME_NSEC = 12, TOPIC_SIZE = 16,
    NAMES = 18, HEADER_MIN = 20, HEADER_ROOM = 256, MOST_PARTS = 255,
    CONTROL = 64, RESEND = 65, REQUEST = 1, CREDIT_SIZE = 12, CREDIT_SHARE = 8, OFFER = 0,
    OFFER_SIZE = 8, REQUEST_SIZE = 8, BITMAP_SIZE = 32, BATCH = 64, NANOS = 1000000000, PARKED = 64,
    FLIGHTS = 16, WINDOW_SHARE = 2,
    ROWS = 64, LONGEST_NANOS = 20000000 // of a run, behind its first datagram; then Python looks around
};

static uint32_t u32(const unsigned char *at)
{
    return at[0] | at[1] << 8 | at[2] << 16 | (uint32_t)at[3] << 24;
}

static void put_u32(unsigned char *at, uint32_t value)
{
    for (int i = 0; i < 4; i++) at[i] = value >> 8 * i & 255;
}

static int64_t now_nanos(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

// An address as `(host, port)`; false, with an exception, where it is none.
static int to_address(const char *host, int port, struct sockaddr_in *address)
{
    memset(address, 0, sizeof *address);
    address->sin_family = AF_INET;
    address->sin_port = htons((uint16_t)port);
    if (inet_pton(AF_INET, host, &address->sin_addr) == 1 && 0 <= port && port <= 65535) return 1;
    PyErr_SetString(PyExc_ValueError, "no numeric IPv4 address with a port");
    return 0;
}

// Parts of a message, and where they are to go.
struct parts {
    struct sockaddr_in to;
    const unsigned char *packed; // the header of part 0
    char *body;
    Py_ssize_t packed_size, body_size, size; // size: of a part, of which the last may lack some
};

// Whether so many parts from `first` on lie in the body; an exception says so where they do not.
static int is_fit(const struct parts *parts, int first, int count)
{
    if (parts->packed_size >= HEADER_MIN && parts->packed_size < HEADER_ROOM && parts->size > 0 &&
        first >= 0 && count > 0 && first + (int64_t)count <= MOST_PARTS &&
        parts->size <= PY_SSIZE_T_MAX / HEADER_ROOM &&
        (first + count - 1) * parts->size < parts->body_size + (parts->body_size == 0))
        return 1;
    PyErr_SetString(PyExc_ValueError, "the parts do not lie in the body");
    return 0;
}

// Send parts in their order until all are out or the kernel does not take one. Return how many.
static int send_some(int fd, const struct parts *parts, int first, int count, int *error)
{
    unsigned char heads[BATCH][HEADER_ROOM];
    struct iovec io[BATCH][2];
    struct mmsghdr rows[BATCH];
    int sent = 0;
    *error = 0;
    while (sent < count && !*error) {
        int most = count - sent < BATCH ? count - sent : BATCH;
        memset(rows, 0, sizeof *rows * most);
        for (int i = 0; i < most; i++) {
            Py_ssize_t start = (first + sent + i) * parts->size, left = parts->body_size - start;
            memcpy(heads[i], parts->packed, parts->packed_size);
            heads[i][PART_NUMBER] = (unsigned char)(first + sent + i);
            io[i][0] = (struct iovec){heads[i], parts->packed_size};
            io[i][1] = (struct iovec){parts->body + start, left < parts->size ? left : parts->size};
            rows[i].msg_hdr = (struct msghdr){.msg_name = (void *)&parts->to,
                                              .msg_namelen = sizeof parts->to,
                                              .msg_iov = io[i], .msg_iovlen = 2};
        }
        int taken = sendmmsg(fd, rows, most, 0);
        if (taken > 0) sent += taken;
        else if (taken == 0 || errno != EINTR) *error = taken ? errno : EAGAIN;
    }
    return sent;
}

// send(fd, (host, port), header of part 0, body, part size, first, count) -> sent, errno or 0
static PyObject *send_parts(PyObject *self, PyObject *args)
{
    int fd, port, first, count, sent = 0, error = 0;
    const char *host;
    Py_buffer packed, body;
    struct parts parts;
    (void)self;
    if (!PyArg_ParseTuple(args, "i(si)y*y*nii", &fd, &host, &port, &packed, &body, &parts.size,
                          &first, &count))
        return NULL;
    parts.packed = packed.buf, parts.packed_size = packed.len;
    parts.body = body.buf, parts.body_size = body.len;
    int is_right = is_fit(&parts, first, count) && to_address(host, port, &parts.to);
    if (is_right) {
        Py_BEGIN_ALLOW_THREADS;
        sent = send_some(fd, &parts, first, count, &error);
        Py_END_ALLOW_THREADS;
    }
    PyBuffer_Release(&packed);
    PyBuffer_Release(&body);
    return is_right ? Py_BuildValue("ii", sent, error) : NULL;
}

// The rest of a message, to be sent as credits come. What is under way is reckoned as in `flow`.
struct order {
    struct parts parts;
    int next, end, sent, is_over; // parts; sent: since it was given
    int64_t cost, in_flight, window;
    int flights_count;
    struct flight {
        uint32_t seq_number;
        int first, count;
        int64_t cost, last_cost;
    } flights[FLIGHTS]; // oldest first; the last one is of the message itself
};

// Credits of one peer for one topic that wait for the sender. All zero it takes none.
struct parking {
    struct sockaddr_in from;
    unsigned char like[HEADER_ROOM + CREDIT_SIZE]; // a credit as it looks but for its numbers
    int like_size, is_awaited, count;              // is_awaited: the sender has to be woken
    struct parked {
        uint32_t seq_number, part_number, receive_buffer;
    } rows[PARKED];
    struct order order; // its bytes are kept by who gave it, until it is taken back
    int is_sending;     // the thread that receives sends of it, without the lock
    pthread_cond_t rest; // it no longer does
    pthread_mutex_t lock; // whoever holds it waits for nothing: no other lock, no call of the kernel
};

static struct parking *parking_in(const Py_buffer *memory)
{
    if (memory->len >= (Py_ssize_t)sizeof(struct parking)) return memory->buf;
    PyErr_SetString(PyExc_ValueError, "too little memory for credits");
    return NULL;
}

// parking() -> memory for credits
static PyObject *make_parking(PyObject *self, PyObject *args)
{
    static const struct parking empty = {.rest = PTHREAD_COND_INITIALIZER,
                                         .lock = PTHREAD_MUTEX_INITIALIZER};
    (void)self, (void)args;
    return PyByteArray_FromStringAndSize((const char *)&empty, sizeof empty);
}

static PyObject *listed(const struct parked *rows, int count)
{
    PyObject *all = PyList_New(count);
    for (int i = 0; all && i < count; i++) {
        PyObject *row = Py_BuildValue("III", rows[i].seq_number, rows[i].part_number,
                                      rows[i].receive_buffer);
        if (row) PyList_SET_ITEM(all, i, row);
        else Py_CLEAR(all);
    }
    return all;
}

// park(memory, (host, port), like) -> [(seq_number, part_number, receive_buffer), ...]
//
// Keeps credits of this peer that look like this one from now on; returns what was kept before.
static PyObject *park(PyObject *self, PyObject *args)
{
    int port, count = 0;
    const char *host;
    Py_buffer memory, like;
    struct sockaddr_in from;
    struct parked rows[PARKED];
    (void)self;
    if (!PyArg_ParseTuple(args, "w*(si)y*", &memory, &host, &port, &like)) return NULL;
    struct parking *parking = parking_in(&memory);
    int is_fit = like.len >= HEADER_MIN + CREDIT_SIZE && like.len <= (int)sizeof parking->like &&
                 like.len == ((unsigned char *)like.buf)[1] + CREDIT_SIZE;
    if (parking && !is_fit) PyErr_SetString(PyExc_ValueError, "no credit looks like this");
    int is_set = parking && is_fit && to_address(host, port, &from);
    if (is_set) {
        pthread_mutex_lock(&parking->lock);
        count = parking->count;
        memcpy(rows, parking->rows, count * sizeof *rows);
        parking->count = 0;
        parking->from = from;
        memcpy(parking->like, like.buf, like.len);
        parking->like_size = (int)like.len;
        pthread_mutex_unlock(&parking->lock);
    }
    PyBuffer_Release(&memory);
    PyBuffer_Release(&like);
    return is_set ? listed(rows, count) : NULL;
}

// parked(memory, is awaited) -> [(seq_number, part_number, receive_buffer), ...]
//
// Takes what was kept. While a credit is awaited none is kept, so that it wakes the sender, unless
// there is an order.
static PyObject *take_parked(PyObject *self, PyObject *args)
{
    int is_awaited, count = 0;
    Py_buffer memory;
    struct parked rows[PARKED];
    (void)self;
    if (!PyArg_ParseTuple(args, "w*p", &memory, &is_awaited)) return NULL;
    struct parking *parking = parking_in(&memory);
    if (parking) {
        pthread_mutex_lock(&parking->lock);
        parking->is_awaited = is_awaited;
        count = parking->count;
        memcpy(rows, parking->rows, count * sizeof *rows);
        parking->count = 0;
        pthread_mutex_unlock(&parking->lock);
    }
    PyBuffer_Release(&memory);
    return parking ? listed(rows, count) : NULL;
}

// order(memory, (host, port), header of part 0, body, part size, next, end, cost, bytes under way,
// window, [(seq_number, first, count, cost, last cost), ...])
//
// Leaves the rest of a message to the thread that receives; header and body must stay until
// it is taken back. Nobody else may send of it until then.
static PyObject *give_order(PyObject *self, PyObject *args)
{
    struct order order = {0};
    int port;
    const char *host;
    Py_buffer memory, packed, body;
    PyObject *flights, *given = NULL;
    (void)self;
    if (!PyArg_ParseTuple(args, "w*(si)y*y*niiLLLO!", &memory, &host, &port, &packed, &body,
                          &order.parts.size, &order.next, &order.end, &order.cost,
                          &order.in_flight, &order.window, &PyList_Type, &flights))
        return NULL;
    struct parking *parking = parking_in(&memory);
    Py_ssize_t count = PyList_GET_SIZE(flights);
    order.parts.packed = packed.buf, order.parts.packed_size = packed.len;
    order.parts.body = body.buf, order.parts.body_size = body.len;
    if (!parking || !is_fit(&order.parts, order.next, order.end - order.next) ||
        !to_address(host, port, &order.parts.to))
        goto end;
    if (count < 1 || count > FLIGHTS || order.cost < 1) {
        PyErr_SetString(PyExc_ValueError, "too much is under way");
        goto end;
    }
    for (int i = 0; i < count; i++) {
        struct flight *flight = order.flights + i;
        if (!PyArg_ParseTuple(PyList_GET_ITEM(flights, i), "IiiLL", &flight->seq_number,
                              &flight->first, &flight->count, &flight->cost, &flight->last_cost))
            goto end;
    }
    order.flights_count = (int)count;
    pthread_mutex_lock(&parking->lock);
    parking->order = order;
    pthread_mutex_unlock(&parking->lock);
    Py_INCREF(Py_None);
    given = Py_None;
end:
    PyBuffer_Release(&memory);
    PyBuffer_Release(&packed);
    PyBuffer_Release(&body);
    return given;
}

// taken_back(memory) -> parts that were sent since an order was given, which holds no more
static PyObject *take_back(PyObject *self, PyObject *args)
{
    int sent = 0;
    Py_buffer memory;
    (void)self;
    if (!PyArg_ParseTuple(args, "w*", &memory)) return NULL;
    struct parking *parking = parking_in(&memory);
    if (parking) {
        Py_BEGIN_ALLOW_THREADS; // who sends may need the interpreter before it has sent
        pthread_mutex_lock(&parking->lock);
        while (parking->is_sending) pthread_cond_wait(&parking->rest, &parking->lock);
        sent = parking->order.sent;
        parking->order.sent = parking->order.flights_count = 0;
        pthread_mutex_unlock(&parking->lock);
        Py_END_ALLOW_THREADS;
    }
    PyBuffer_Release(&memory);
    return parking ? PyLong_FromLong(sent) : NULL;
}

// What is expected next, and what came of it.
struct run {
    Py_buffer rest, block, head, parking; // rest: for what has no other place; head: as it is expected
    Py_buffer arrived;               // for each part whether it is in
    unsigned char is_in[MOST_PARTS]; // the same, and with what came in this run
    unsigned char came[HEADER_ROOM]; // the header of the first part; behind it only stray ones
    struct sockaddr_in sender, from; // of the parts; of the last datagram
    Py_ssize_t part_size, last_size; // last_size: body bytes of the message's last part
    int fd, next, missing;           // the part that is expected next; how many are missing
    int is_open;                     // a part of the message was taken before: all must be alike
    struct {
        int first, count;
    } rows[ROWS]; // parts that came, by order; those in a row together
    int rows_count, credits, error, parked, is_over; // is_over: an order was carried out, or failed
    unsigned long long parked_bytes;
    unsigned int control_number, receive_buffer;
    unsigned long long uncredited;
    long long due_nanos; // nothing is waited for longer behind a part; 0: it is
    long long patience_nanos; // so long behind a gap it is due; 0: never
    int may_ask;              // for gaps, when that is due
    unsigned int goodput;     // to be told then
    long long asked_nanos;    // when that was done, and for what; the bitmap is of so many bytes
    unsigned char asked[BITMAP_SIZE];
    int asked_size;
    long long drops; // that the kernel told of; -1 where it did not
    PyThreadState *thread; // while the interpreter is given away
};

static char *place_of(const struct run *run, int number)
{
    return (char *)run->block.buf + number * run->part_size;
}

// Receive one datagram: header apart, body into the place of the next part. Return its size.
static Py_ssize_t receive_one(struct run *run, unsigned char *head, int flags)
{
    int is_placed = run->missing > 0;
    struct iovec io[3] = {
        {head, is_placed ? run->head.len : 0},
        {place_of(run, run->next), is_placed ? run->part_size : 0},
        {run->rest.buf, run->rest.len},
    };
    _Alignas(struct cmsghdr) char control[64];
    struct msghdr message = {.msg_name = &run->from, .msg_namelen = sizeof run->from,
                             .msg_iov = io, .msg_iovlen = 3,
                             .msg_control = control, .msg_controllen = sizeof control};
    Py_ssize_t size = recvmsg(run->fd, &message, flags);
    run->error = size < 0 ? errno : 0;
    if (size == 0 && message.msg_namelen == 0) { // so does the kernel tell that it was shut
        run->error = ESHUTDOWN;
        return -1;
    }
    struct cmsghdr *told = size < 0 ? NULL : CMSG_FIRSTHDR(&message); // nothing else is asked for
    if (told && told->cmsg_level == SOL_SOCKET && told->cmsg_type == SO_RXQ_OVFL) {
        uint32_t drops;
        memcpy(&drops, CMSG_DATA(told), sizeof drops);
        run->drops = drops;
    }
    return size;
}

static int is_next_in_row(const struct run *run, int number)
{
    int last = run->rows_count - 1;
    return last >= 0 && number == run->rows[last].first + run->rows[last].count;
}

// Whether a datagram is a part that is missing. Of a message of which nothing was taken before, seq_number
// and time are its own, and the first part comes first; `receiving` has seen all else of the header in
// another message.
static int is_expected(const struct run *run, const unsigned char *head, Py_ssize_t size)
{
    int number = head[PART_NUMBER], header_size = (int)run->head.len;
    Py_ssize_t body = size - header_size;
    if (!run->missing || body <= 0 || body > run->part_size) return 0;
    if (number >= run->arrived.len || run->is_in[number]) return 0;
    if (run->from.sin_addr.s_addr != run->sender.sin_addr.s_addr ||
        run->from.sin_port != run->sender.sin_port)
        return 0;
    int is_begun = run->is_open || run->rows_count;
    if (number != run->next && !is_begun) return 0;
    if (run->rows_count == ROWS && !is_next_in_row(run, number)) return 0;
    const unsigned char *wanted = run->rows_count ? run->came : run->head.buf;
    return head[PARTS_MAX] == wanted[PARTS_MAX] &&
           (body == run->part_size || number == wanted[PARTS_MAX] - 1) &&
           !memcmp(head, wanted, SEQ_NUMBER) &&
           !memcmp(head + TOPIC_SIZE, wanted + TOPIC_SIZE, header_size - TOPIC_SIZE) &&
           (is_begun ? !memcmp(head + SEQ_NUMBER, wanted + SEQ_NUMBER, 4) &&
                           !memcmp(head + TIME, wanted + TIME, 8)
                     : u32(head + TIME_NSEC) < NANOS);
}

// Begin a datagram that answers a part, in memory that is all zero; return where its body goes.
static unsigned char *answer_to(const unsigned char *head, unsigned char *answer, int msg_type,
                                uint32_t seq_number)
{
    int topic_size = head[TOPIC_SIZE], size = (NAMES + topic_size + 3) & ~3;
    answer[0] = (unsigned char)msg_type;
    answer[1] = (unsigned char)size;
    put_u32(answer + SEQ_NUMBER, seq_number);
    answer[PARTS_MAX] = 1;
    memcpy(answer + TIME, head + TIME, 8);
    answer[TOPIC_SIZE] = head[TOPIC_SIZE];
    memcpy(answer + NAMES, head + NAMES, topic_size);
    return answer + size;
}

static int is_answered(const struct run *run, const unsigned char *answer, size_t size)
{
    return sendto(run->fd, answer, size, 0, (const struct sockaddr *)&run->sender,
                  sizeof run->sender) == (ssize_t)size;
}

// Acknowledge a part, as `receiving` would; return whether it went out.
static int send_credit(struct run *run, const unsigned char *head)
{
    unsigned char credit[HEADER_ROOM + CREDIT_SIZE] = {0};
    unsigned char *body = answer_to(head, credit, CONTROL, run->control_number + run->credits);
    body[1] = head[0];
    body[2] = head[PART_NUMBER];
    memcpy(body + 4, head + SEQ_NUMBER, 4);
    put_u32(body + 8, run->receive_buffer);
    return is_answered(run, credit, body + CREDIT_SIZE - credit);
}

// Ask for the parts before `end` that are missing, as `resend_asking` would, which takes it from
// there. Once in a run, of a message of which nothing was asked for before.
static void send_request(struct run *run, int end)
{
    unsigned char request[HEADER_ROOM + REQUEST_SIZE + BITMAP_SIZE] = {0};
    unsigned char *body = answer_to(run->came, request, RESEND, u32(run->came + SEQ_NUMBER));
    int size = ((int)run->arrived.len + 7) / 8, missing = 0;
    body[0] = REQUEST;
    body[1] = run->came[0];
    body[2] = run->came[PARTS_MAX];
    body[3] = 1; // message
    put_u32(body + 4, run->goodput);
    for (int i = 0; i < end; i++) {
        missing += !run->is_in[i];
        body[REQUEST_SIZE + i / 8] |= !run->is_in[i] << i % 8;
    }
    run->due_nanos = 0;
    if (!missing) return; // they only came late
    run->may_ask = 0;
    if (!is_answered(run, request, body + REQUEST_SIZE + size - request)) return;
    memcpy(run->asked, body + REQUEST_SIZE, size);
    run->asked_size = size;
    run->asked_nanos = now_nanos();
    run->due_nanos = run->asked_nanos + LONGEST_NANOS; // then the answer is late
}

// Copy a datagram that lies in three places.
static void gather(const struct run *run, const unsigned char *head, Py_ssize_t size, char *to)
{
    int is_placed = run->missing > 0;
    Py_ssize_t room[3] = {is_placed ? run->head.len : 0, is_placed ? run->part_size : 0, size};
    const void *from[3] = {
        head, place_of(run, run->next), run->rest.buf};
    for (Py_ssize_t at = 0, i = 0; i < 3; i++) {
        Py_ssize_t some = size - at < room[i] ? size - at : room[i];
        memcpy(to + at, from[i], some);
        at += some;
    }
}

// Whether a datagram says that all parts of the message that parts came of have been sent.
static int is_offer(const struct run *run, const unsigned char *head, Py_ssize_t size)
{
    unsigned char offer[HEADER_ROOM + OFFER_SIZE], like[HEADER_ROOM + OFFER_SIZE] = {0};
    if (!run->rows_count || run->from.sin_addr.s_addr != run->sender.sin_addr.s_addr ||
        run->from.sin_port != run->sender.sin_port)
        return 0;
    unsigned char *body = answer_to(run->came, like, RESEND, u32(run->came + SEQ_NUMBER));
    body[0] = OFFER;
    body[1] = run->came[0];
    body[2] = run->came[PARTS_MAX];
    if (size != body + OFFER_SIZE - like) return 0;
    gather(run, head, size, (char *)offer);
    return !memcmp(offer, like, body + 3 - like);
}

static int64_t cost_of(const struct flight *flight, int count)
{
    int is_all = count > 0 && count == flight->count;
    return is_all ? (count - 1) * flight->cost + flight->last_cost : count * flight->cost;
}

// Free what a credit acknowledges; return how many parts may go then. If none, nothing was done:
// the sender has to judge it.
static int make_room(struct order *order, const unsigned char *credit)
{
    int64_t freed = 0;
    int i = 0, popped = 0, left = order->end - order->next;
    for (; i < order->flights_count; i++) {
        const struct flight *flight = order->flights + i;
        popped = credit[2] - flight->first + 1;
        if (flight->seq_number == u32(credit + 4) && 1 <= popped && popped <= flight->count) break;
        freed += cost_of(flight, flight->count);
    }
    if (i == order->flights_count || u32(credit + 8) / WINDOW_SHARE != order->window) return 0;
    freed += cost_of(order->flights + i, popped);
    int64_t room = (order->window - order->in_flight + freed) / order->cost;
    if (room < 1 || left < 1 || order->is_over) return 0;
    order->flights[i].first += popped;
    order->flights[i].count -= popped;
    order->flights_count -= i;
    order->in_flight -= freed;
    memmove(order->flights, order->flights + i, order->flights_count * sizeof *order->flights);
    return room < left ? (int)room : left;
}

// Send so many parts of the order. The caller holds the lock, and again when this returns.
static void go_on(struct run *run, struct parking *parking, int count)
{
    struct order *order = &parking->order;
    int error;
    parking->is_sending = 1; // so nobody else changes the order
    pthread_mutex_unlock(&parking->lock);
    if (!run->thread) run->thread = PyEval_SaveThread(); // others may compute meanwhile
    int sent = send_some(run->fd, &order->parts, order->next, count, &error);
    pthread_mutex_lock(&parking->lock);
    parking->is_sending = 0;
    pthread_cond_broadcast(&parking->rest);
    order->flights[order->flights_count - 1].count += sent;
    order->in_flight += sent * order->cost;
    order->next += sent;
    order->sent += sent;
    order->is_over = error || order->next == order->end;
    run->is_over = order->is_over;
}

// Keep a datagram for the sender, if it is a credit that can wait; return whether it was kept.
static int keep_credit(struct run *run, const unsigned char *head, Py_ssize_t size)
{
    struct parking *parking = run->parking.buf;
    unsigned char credit[HEADER_ROOM + CREDIT_SIZE];
    int is_kept = 0, count = 0;
    if (size > (Py_ssize_t)sizeof credit) return 0;
    gather(run, head, size, (char *)credit);
    const unsigned char *body = credit + size - CREDIT_SIZE;
    pthread_mutex_lock(&parking->lock);
    const unsigned char *like = parking->like;
    if (size == parking->like_size && parking->count < PARKED &&
        run->from.sin_addr.s_addr == parking->from.sin_addr.s_addr &&
        run->from.sin_port == parking->from.sin_port && !memcmp(credit, like, SEQ_NUMBER) &&
        !memcmp(credit + PART_NUMBER, like + PART_NUMBER, TIME - PART_NUMBER) &&
        u32(credit + TIME_NSEC) < NANOS &&
        !memcmp(credit + TOPIC_SIZE, like + TOPIC_SIZE, size - CREDIT_SIZE - TOPIC_SIZE) &&
        !memcmp(body, like + size - CREDIT_SIZE, 2) &&
        (!parking->is_awaited || (count = make_room(&parking->order, body)))) {
        parking->rows[parking->count++] = (struct parked){u32(body + 4), body[2], u32(body + 8)};
        is_kept = 1;
        if (count) go_on(run, parking, count);
    }
    pthread_mutex_unlock(&parking->lock);
    run->parked += is_kept;
    run->parked_bytes += is_kept ? size : 0;
    return is_kept;
}

static int is_gap_before(const struct run *run, int number)
{
    while (number && run->is_in[number - 1]) number--;
    return number > 0;
}

// Take note of a part, put it where it belongs, and acknowledge it if that is due; return whether
// that went well.
static int take_part(struct run *run, const unsigned char *head, Py_ssize_t size)
{
    int number = head[PART_NUMBER], last = (int)run->arrived.len - 1;
    if (!run->rows_count) memcpy(run->came, head, run->head.len);
    if (number != run->next) {
        memcpy(place_of(run, number), place_of(run, run->next), size - run->head.len);
        int64_t due_nanos = now_nanos() + run->patience_nanos;
        int is_sooner = !run->due_nanos || due_nanos < run->due_nanos;
        if (run->patience_nanos && is_sooner && is_gap_before(run, number))
            run->due_nanos = due_nanos;
    }
    if (!is_next_in_row(run, number)) {
        run->rows[run->rows_count].first = number;
        run->rows[run->rows_count++].count = 0;
    }
    run->rows[run->rows_count - 1].count++;
    run->is_in[number] = 1;
    run->missing--;
    if (number > run->next) run->next = number; // behind one sent again it goes on where it was
    while (run->missing && run->is_in[run->next]) run->next = run->next < last ? run->next + 1 : 0;
    if (number == last) run->last_size = size - run->head.len;
    run->uncredited += size;
    if (run->missing && number != last && run->uncredited <= run->receive_buffer / CREDIT_SHARE)
        return 1;
    if (!send_credit(run, head)) return 0; // then it is still due
    run->uncredited = 0;
    run->credits++;
    return 1;
}

// Receive one datagram, which is waited for as long as nothing else is due.
static Py_ssize_t receive_next(struct run *run, unsigned char *head)
{
    for (;;) {
        int waits = !run->rows_count || !run->due_nanos;
        int64_t left = waits ? 0 : run->due_nanos - now_nanos();
        if (!waits && left <= 0) {
            if (!run->may_ask) return -1;
            int end = (int)run->arrived.len;
            while (!run->is_in[end - 1]) end--;
            send_request(run, end);
            continue;
        }
        Py_ssize_t size = receive_one(run, head, waits ? 0 : MSG_DONTWAIT);
        if (size >= 0 || waits || run->error != EAGAIN) return size;
        struct timespec most = {left / NANOS, left % NANOS};
        struct pollfd source = {.fd = run->fd, .events = POLLIN};
        ppoll(&source, 1, &most, NULL);
    }
}

// Receive until something comes that is not expected. Return its size; -1 where nothing did.
static Py_ssize_t receive_parts(struct run *run, unsigned char *head, int is_flowing)
{
    int64_t until_nanos = 0;
    Py_ssize_t size = -1;
    // What lies there is taken without giving the interpreter away, for that may cost milliseconds.
    if (is_flowing) size = receive_one(run, head, MSG_DONTWAIT);
    if (size < 0 && (!is_flowing || run->error == EAGAIN)) {
        run->thread = PyEval_SaveThread();
        size = receive_one(run, head, 0);
    }
    while (size >= 0) {
        int is_part = is_expected(run, head, size);
        if (!is_part && !keep_credit(run, head, size)) {
            if (run->may_ask && is_offer(run, head, size))
                send_request(run, (int)run->arrived.len);
            break;
        }
        if (!run->thread) run->thread = PyEval_SaveThread();
        int is_over =
            is_part ? !take_part(run, head, size) || !run->missing : run->is_over;
        size = -1;
        if (is_over) break;
        if (!until_nanos) until_nanos = now_nanos() + LONGEST_NANOS;
        else if (now_nanos() > until_nanos) break;
        size = receive_next(run, head);
    }
    if (run->thread) PyEval_RestoreThread(run->thread);
    return size;
}

static PyObject *rows_of(const struct run *run)
{
    PyObject *rows = PyTuple_New(run->rows_count);
    for (int i = 0; rows && i < run->rows_count; i++) {
        PyObject *row = Py_BuildValue("ii", run->rows[i].first, run->rows[i].count);
        if (row) PyTuple_SET_ITEM(rows, i, row);
        else Py_CLEAR(rows);
    }
    return rows;
}

// Whether what is expected lies in its block; an exception says so where it does not.
static int is_sound(struct run *run)
{
    const unsigned char *head = run->head.buf, *arrived = run->arrived.buf;
    Py_ssize_t count = run->arrived.len;
    int is_right = run->rest.len >= 65536 && run->head.len < HEADER_ROOM && count <= MOST_PARTS &&
                   (!count || (run->head.len >= HEADER_MIN && run->part_size > 0 &&
                               run->part_size <= run->block.len &&
                               count * run->part_size <= run->block.len &&
                               NAMES + head[TOPIC_SIZE] <= run->head.len && head[PARTS_MAX] >= 2));
    for (Py_ssize_t i = 0; is_right && i < count; i++) {
        run->is_in[i] = arrived[i];
        run->missing += !arrived[i];
    }
    if (run->missing) is_right &= 0 <= run->next && run->next < count && !arrived[run->next];
    else run->next = 0;
    if (!is_right) PyErr_SetString(PyExc_ValueError, "the parts do not lie in the block");
    return is_right;
}

// receive(fd, rest, block, header, (host, port), part size, next, which are in, is open, due,
// patience, may ask, uncredited, receive buffer, control number, goodput, is flowing, memory for
// credits) -> None, or (header, ((first, count), ...), last size, credits, uncredited, stray datagram
// or None, its sender, why it is refused, credits kept, their bytes, whether an order is over, bitmap
// of what was asked for, when), errno, drops
static PyObject *receive(PyObject *self, PyObject *args)
{
    struct run run = {.drops = -1};
    int port, is_flowing;
    const char *host;
    (void)self;
    if (!PyArg_ParseTuple(args, "iw*w*y*(si)niy*pLLpKIIIpw*", &run.fd, &run.rest, &run.block,
                          &run.head, &host, &port, &run.part_size, &run.next, &run.arrived,
                          &run.is_open, &run.due_nanos, &run.patience_nanos, &run.may_ask,
                          &run.uncredited, &run.receive_buffer, &run.control_number, &run.goodput,
                          &is_flowing, &run.parking))
        return NULL;
    PyObject *found = NULL, *stray = NULL, *sender = NULL, *rows = NULL;
    unsigned char head[HEADER_ROOM];
    if (!is_sound(&run) || !parking_in(&run.parking) || !to_address(host, port, &run.sender))
        goto end;
    run.last_size = run.part_size;
    Py_ssize_t size = receive_parts(&run, head, is_flowing);
    if (size < 0 && !run.rows_count && !run.parked) {
        Py_INCREF(Py_None);
        found = Py_None;
        goto end;
    }
    rows = rows_of(&run);
    if (!rows) goto end;
    if (size >= 0) {
        char name[INET_ADDRSTRLEN] = "";
        inet_ntop(AF_INET, &run.from.sin_addr, name, sizeof name);
        stray = PyBytes_FromStringAndSize(NULL, size);
        if (stray) gather(&run, head, size, PyBytes_AS_STRING(stray));
        sender = Py_BuildValue("si", name, ntohs(run.from.sin_port));
        if (!stray || !sender) goto end;
    }
    found = Py_BuildValue("(y#OniKOOsiKiy#L)iL", run.came, run.rows_count ? run.head.len : 0, rows,
                          run.last_size, run.credits, run.uncredited, stray ? stray : Py_None,
                          sender ? sender : Py_None, "", run.parked, run.parked_bytes, run.is_over,
                          run.asked, (Py_ssize_t)run.asked_size, run.asked_nanos, run.error,
                          run.drops);
end:
    Py_XDECREF(rows);
    Py_XDECREF(stray);
    Py_XDECREF(sender);
    PyBuffer_Release(&run.rest);
    PyBuffer_Release(&run.block);
    PyBuffer_Release(&run.head);
    PyBuffer_Release(&run.arrived);
    PyBuffer_Release(&run.parking);
    return found;
}

static PyMethodDef methods[] = {
    {"send", send_parts, METH_VARARGS, "Send parts of a message."},
    {"receive", receive, METH_VARARGS, "Receive parts of a message, and what is none."},
    {"parking", make_parking, METH_NOARGS, "Make memory for credits."},
    {"park", park, METH_VARARGS, "Keep credits that look like one."},
    {"parked", take_parked, METH_VARARGS, "Take the credits that were kept."},
    {"order", give_order, METH_VARARGS, "Leave the rest of a message to who receives credits."},
    {"taken_back", take_back, METH_VARARGS, "Take that back; return how many parts were sent."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "_runs", "See runs.py.", 0, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__runs(void)
{
    return PyModule_Create(&module);
}
