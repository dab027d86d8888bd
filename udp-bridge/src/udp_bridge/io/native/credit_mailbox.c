// SPDX-License-Identifier: Apache-2.0
// The credit mailbox: Credits that wait for the sender, and the send that it delegated.
//
// The receiving and the sending thread share a `struct mailbox`, guarded by its lock only.
#include "batch_io.h"

#include <string.h>

struct mailbox *mailbox_in(const Py_buffer *memory)
{
    if (memory->len >= (Py_ssize_t)sizeof(struct mailbox)) return memory->buf;
    PyErr_SetString(PyExc_ValueError, "too little memory for a mailbox");
    return NULL;
}

// mailbox() -> memory of a mailbox
PyObject *make_mailbox(PyObject *self, PyObject *args)
{
    static const struct mailbox empty = {.sending_ended = PTHREAD_COND_INITIALIZER,
                                         .lock = PTHREAD_MUTEX_INITIALIZER};
    (void)self, (void)args;
    return PyByteArray_FromStringAndSize((const char *)&empty, sizeof empty);
}

static PyObject *to_list(const struct kept_credit *credits, int count)
{
    PyObject *all = PyList_New(count);
    for (int i = 0; all && i < count; i++) {
        PyObject *row = Py_BuildValue("III", credits[i].seq_number, credits[i].part_number,
                                      credits[i].receive_buffer);
        if (row) PyList_SET_ITEM(all, i, row);
        else Py_CLEAR(all);
    }
    return all;
}

// keep(memory, (host, port), pattern) -> [(seq_number, part_number, receive_buffer), ...]
//
// Keeps Credits of this peer that match the pattern from now on; returns those kept before.
PyObject *keep(PyObject *self, PyObject *args)
{
    int port, count = 0;
    const char *host;
    Py_buffer memory, pattern;
    struct sockaddr_in from;
    struct kept_credit credits[MAILBOX_SIZE];
    (void)self;
    if (!PyArg_ParseTuple(args, "w*(si)y*", &memory, &host, &port, &pattern)) return NULL;
    struct mailbox *mailbox = mailbox_in(&memory);
    int is_credit = pattern.len >= HEADER_MIN + CREDIT_SIZE &&
                    pattern.len <= (int)sizeof mailbox->pattern &&
                    pattern.len == ((unsigned char *)pattern.buf)[1] + CREDIT_SIZE;
    if (mailbox && !is_credit) PyErr_SetString(PyExc_ValueError, "the pattern is no Credit");
    int is_set = mailbox && is_credit && to_address(host, port, &from);
    if (is_set) {
        pthread_mutex_lock(&mailbox->lock);
        count = mailbox->count;
        memcpy(credits, mailbox->credits, count * sizeof *credits);
        mailbox->count = 0;
        mailbox->from = from;
        memcpy(mailbox->pattern, pattern.buf, pattern.len);
        mailbox->pattern_size = (int)pattern.len;
        pthread_mutex_unlock(&mailbox->lock);
    }
    PyBuffer_Release(&memory);
    PyBuffer_Release(&pattern);
    return is_set ? to_list(credits, count) : NULL;
}

// collect(memory, is_awaited) -> [(seq_number, part_number, receive_buffer), ...]
//
// Returns and removes the kept Credits. While one is awaited none is kept, so that it wakes the
// sender, except for a delegated send.
PyObject *collect(PyObject *self, PyObject *args)
{
    int is_awaited, count = 0;
    Py_buffer memory;
    struct kept_credit credits[MAILBOX_SIZE];
    (void)self;
    if (!PyArg_ParseTuple(args, "w*p", &memory, &is_awaited)) return NULL;
    struct mailbox *mailbox = mailbox_in(&memory);
    if (mailbox) {
        pthread_mutex_lock(&mailbox->lock);
        mailbox->is_awaited = is_awaited;
        count = mailbox->count;
        memcpy(credits, mailbox->credits, count * sizeof *credits);
        mailbox->count = 0;
        pthread_mutex_unlock(&mailbox->lock);
    }
    PyBuffer_Release(&memory);
    return mailbox ? to_list(credits, count) : NULL;
}

// delegate(memory, (host, port), header of part 0, body, part size, next, end, cost, bytes in
// flight, window, [(seq_number, first, count, cost, last cost), ...])
//
// Lets the receiving thread send the rest of a message as Credits arrive. The caller must keep
// header and body, and must not send parts of the message, until `reclaim`.
PyObject *delegate(PyObject *self, PyObject *args)
{
    struct delegated_send send = {0};
    int port;
    const char *host;
    Py_buffer memory, packed, body;
    PyObject *ranges, *done = NULL;
    (void)self;
    if (!PyArg_ParseTuple(args, "w*(si)y*y*niiLLLO!", &memory, &host, &port, &packed, &body,
                          &send.parts.size, &send.next, &send.end, &send.cost,
                          &send.in_flight_bytes, &send.window_bytes, &PyList_Type, &ranges))
        return NULL;
    struct mailbox *mailbox = mailbox_in(&memory);
    Py_ssize_t count = PyList_GET_SIZE(ranges);
    send.parts.packed = packed.buf, send.parts.packed_size = packed.len;
    send.parts.body = body.buf, send.parts.body_size = body.len;
    if (!mailbox || !lies_in_body(&send.parts, send.next, send.end - send.next) ||
        !to_address(host, port, &send.parts.to))
        goto end;
    if (count < 1 || count > MAX_RANGES || send.cost < 1) {
        PyErr_SetString(PyExc_ValueError, "too many ranges are in flight");
        goto end;
    }
    for (int i = 0; i < count; i++) {
        struct part_range *range = send.in_flight + i;
        if (!PyArg_ParseTuple(PyList_GET_ITEM(ranges, i), "IiiLL", &range->seq_number,
                              &range->first, &range->count, &range->cost, &range->last_cost))
            goto end;
    }
    send.in_flight_count = (int)count;
    pthread_mutex_lock(&mailbox->lock);
    mailbox->send = send;
    pthread_mutex_unlock(&mailbox->lock);
    Py_INCREF(Py_None);
    done = Py_None;
end:
    PyBuffer_Release(&memory);
    PyBuffer_Release(&packed);
    PyBuffer_Release(&body);
    return done;
}

// reclaim(memory) -> number of parts sent since `delegate`, whose send ends
PyObject *reclaim(PyObject *self, PyObject *args)
{
    int sent = 0;
    Py_buffer memory;
    (void)self;
    if (!PyArg_ParseTuple(args, "w*", &memory)) return NULL;
    struct mailbox *mailbox = mailbox_in(&memory);
    if (mailbox) {
        Py_BEGIN_ALLOW_THREADS; // the other thread may need the interpreter first
        pthread_mutex_lock(&mailbox->lock);
        while (mailbox->is_sending) pthread_cond_wait(&mailbox->sending_ended, &mailbox->lock);
        sent = mailbox->send.sent;
        mailbox->send.sent = mailbox->send.in_flight_count = 0;
        pthread_mutex_unlock(&mailbox->lock);
        Py_END_ALLOW_THREADS;
    }
    PyBuffer_Release(&memory);
    return mailbox ? PyLong_FromLong(sent) : NULL;
}

static int64_t cost_of(const struct part_range *range, int count)
{
    int is_all = count > 0 && count == range->count;
    return is_all ? (count - 1) * range->cost + range->last_cost : count * range->cost;
}

// Apply a Credit to a delegated send; return how many parts fit into the window then. 0: nothing was
// changed, and the sender has to handle the Credit.
static int make_room(struct delegated_send *send, const unsigned char *credit)
{
    int64_t freed = 0;
    int i = 0, popped = 0, left = send->end - send->next;
    for (; i < send->in_flight_count; i++) {
        const struct part_range *range = send->in_flight + i;
        popped = credit[2] - range->first + 1;
        if (range->seq_number == u32(credit + 4) && 1 <= popped && popped <= range->count) break;
        freed += cost_of(range, range->count);
    }
    if (i == send->in_flight_count) return 0;
    if (u32(credit + 8) / WINDOW_SHARE != send->window_bytes) return 0;
    freed += cost_of(send->in_flight + i, popped);
    int64_t room = (send->window_bytes - send->in_flight_bytes + freed) / send->cost;
    if (room < 1 || left < 1 || send->is_over) return 0;
    send->in_flight[i].first += popped;
    send->in_flight[i].count -= popped;
    send->in_flight_count -= i;
    send->in_flight_bytes -= freed;
    memmove(send->in_flight, send->in_flight + i, send->in_flight_count * sizeof *send->in_flight);
    return room < left ? (int)room : left;
}

// Send parts of a delegated send. The caller holds the lock, which is released meanwhile.
static void send_delegated(struct part_batch *batch, struct mailbox *mailbox, int count)
{
    struct delegated_send *send = &mailbox->send;
    int error;
    mailbox->is_sending = 1; // so that the send does not change
    pthread_mutex_unlock(&mailbox->lock);
    if (!batch->thread) batch->thread = PyEval_SaveThread();
    int sent = send_range(batch->fd, &send->parts, send->next, count, &error);
    pthread_mutex_lock(&mailbox->lock);
    mailbox->is_sending = 0;
    pthread_cond_broadcast(&mailbox->sending_ended);
    send->in_flight[send->in_flight_count - 1].count += sent;
    send->in_flight_bytes += sent * send->cost;
    send->next += sent;
    send->sent += sent;
    send->is_over = error || send->next == send->end;
    batch->is_delegated_done = send->is_over;
}

// Keep a datagram for the sender if it is a matching Credit; return whether it was kept.
int keep_credit(struct part_batch *batch, const unsigned char *head, Py_ssize_t size)
{
    struct mailbox *mailbox = batch->mailbox.buf;
    unsigned char credit[HEADER_ROOM + CREDIT_SIZE];
    int is_kept = 0, count = 0;
    if (size < HEADER_MIN + CREDIT_SIZE || size > (Py_ssize_t)sizeof credit) return 0;
    copy_datagram(batch, head, size, (char *)credit);
    const unsigned char *body = credit + size - CREDIT_SIZE;
    pthread_mutex_lock(&mailbox->lock);
    const unsigned char *pattern = mailbox->pattern;
    if (size == mailbox->pattern_size && mailbox->count < MAILBOX_SIZE &&
        batch->source.sin_addr.s_addr == mailbox->from.sin_addr.s_addr &&
        batch->source.sin_port == mailbox->from.sin_port && !memcmp(credit, pattern, SEQ_NUMBER) &&
        !memcmp(credit + PART_NUMBER, pattern + PART_NUMBER, TIME - PART_NUMBER) &&
        u32(credit + TIME_NSEC) < NANOS &&
        !memcmp(credit + TOPIC_SIZE, pattern + TOPIC_SIZE, size - CREDIT_SIZE - TOPIC_SIZE) &&
        !memcmp(body, pattern + size - CREDIT_SIZE, 2) &&
        (!mailbox->is_awaited || (count = make_room(&mailbox->send, body)))) {
        mailbox->credits[mailbox->count++] =
            (struct kept_credit){u32(body + 4), body[2], u32(body + 8)};
        is_kept = 1;
        if (count) send_delegated(batch, mailbox, count);
    }
    pthread_mutex_unlock(&mailbox->lock);
    batch->kept += is_kept;
    batch->kept_bytes += is_kept ? size : 0;
    return is_kept;
}
