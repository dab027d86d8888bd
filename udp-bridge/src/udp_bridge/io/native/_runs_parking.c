// SPDX-License-Identifier: Apache-2.0
// Credits wait here while a sender has room, and what it left to be sent as they come.
//
// The thread that receives and the one that sends meet in a `struct parking`, under its lock alone.
#include "_runs.h"

#include <string.h>

struct parking *parking_in(const Py_buffer *memory)
{
    if (memory->len >= (Py_ssize_t)sizeof(struct parking)) return memory->buf;
    PyErr_SetString(PyExc_ValueError, "too little memory for credits");
    return NULL;
}

// parking() -> memory for credits
PyObject *make_parking(PyObject *self, PyObject *args)
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
PyObject *park(PyObject *self, PyObject *args)
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
PyObject *take_parked(PyObject *self, PyObject *args)
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
PyObject *give_order(PyObject *self, PyObject *args)
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
PyObject *take_back(PyObject *self, PyObject *args)
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

static int64_t cost_of(const struct flight *flight, int count)
{
    int is_all = count > 0 && count == flight->count;
    return is_all ? (count - 1) * flight->cost + flight->last_cost : count * flight->cost;
}

// Free what a credit acknowledges; return how many parts may go then. If none, nothing was done:
// the sender has to judge it.
int make_room(struct order *order, const unsigned char *credit)
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
