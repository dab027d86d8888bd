// SPDX-License-Identifier: Apache-2.0
// Messages that are next in order: small ones as `SmallTopics.take` finds them, and large ones that
// arrived whole. Their user gets them before anything else is done with them.
#include "batch_io.h"

enum { STATE_SIZE = 16 }; // `_STATE`

// Return a named tuple of these items, which are given away, or NULL where one of them is missing.
static PyObject *named_tuple(PyObject *type, int count, PyObject **items)
{
    PyObject *made = ((PyTypeObject *)type)->tp_alloc((PyTypeObject *)type, count);
    for (int i = 0; i < count; i++) {
        if (!items[i]) Py_CLEAR(made);
        if (made) PyTuple_SET_ITEM(made, i, items[i]);
        else Py_XDECREF(items[i]);
    }
    return made;
}

// What the next message of a topic has, if it is in order.
struct upcoming {
    uint32_t number;
    int is_stamp_ordered;
    int64_t last_stamp;
};

static int64_t stamp_of(const unsigned char *head)
{
    return (int32_t)u32(head + TIME) * (int64_t)NANOS + u32(head + TIME_NSEC);
}

static int is_next(const unsigned char *head, const struct upcoming *next)
{
    return u32(head + SEQ_NUMBER) == next->number && u32(head + TIME_NSEC) < NANOS &&
           (!next->is_stamp_ordered || stamp_of(head) >= next->last_stamp);
}

// Return the message of a header and a body, which is given away, and its record. `names` are
// msg_type, name and link; size is that of all its datagrams.
static PyObject *delivered(const unsigned char *head, PyObject *source, PyObject *const *names,
                           PyObject *body, Py_ssize_t size, const struct small_topics *small,
                           PyObject **record)
{
    uint32_t number = u32(head + SEQ_NUMBER);
    int parts = head[PARTS_MAX];
    int64_t stamp = stamp_of(head);
    PyObject *fields[] = {
        Py_NewRef(names[0]), Py_NewRef(names[1]), Py_NewRef(names[2]), PyLong_FromLongLong(stamp),
        PyLong_FromUnsignedLong(number), body, PyLong_FromLong(parts),
    };
    PyObject *message = named_tuple(small->message_type, 7, fields);
    *record = NULL;
    if (message) {
        PyObject *values[] = {
            Py_NewRef(source), Py_BuildValue("(IL)", number, (long long)stamp),
            PyLong_FromSsize_t(size - parts * head[1]), PyLong_FromLong(parts),
            PyLong_FromSsize_t(size), PyLong_FromLongLong(now_nanos()),
        };
        *record = named_tuple(small->record_type, 6, values);
        if (!*record) Py_CLEAR(message);
    }
    return message;
}

// Return the message that continues a topic. `row` is a tuple: topic, state, msg_type, name, link.
static PyObject *continued(PyObject *row, PyObject *datagram, const struct small_topics *small)
{
    PyObject *state = PyTuple_Check(row) && PyTuple_GET_SIZE(row) == 5 ? PyTuple_GET_ITEM(row, 1) : NULL;
    if (!state || !PyByteArray_Check(state) || PyByteArray_GET_SIZE(state) != STATE_SIZE) {
        PyErr_SetString(PyExc_TypeError, "this is no small topic");
        return NULL;
    }
    const unsigned char *head = (unsigned char *)PyBytes_AS_STRING(datagram);
    unsigned char *bytes = (unsigned char *)PyByteArray_AS_STRING(state);
    struct upcoming next = {u32(bytes), bytes[4],
                            (int64_t)(u32(bytes + 8) | (uint64_t)u32(bytes + 12) << 32)};
    if (head[PART_NUMBER] || head[PARTS_MAX] != 1 || !is_next(head, &next)) return NULL;
    PyObject *whole = PyMemoryView_FromObject(datagram);
    PyObject *body = whole ? PySequence_GetSlice(whole, head[1], PyBytes_GET_SIZE(datagram)) : NULL;
    PyObject *record, *message = delivered(head, PyTuple_GET_ITEM(row, 0),
                                           PySequence_Fast_ITEMS(row) + 2, body,
                                           PyBytes_GET_SIZE(datagram), small, &record);
    Py_XDECREF(whole);
    if (message && PyList_Append(small->delivered, record)) Py_CLEAR(message);
    Py_XDECREF(record);
    if (message) {
        uint64_t stamp = (uint64_t)stamp_of(head);
        put_u32(bytes, next.number + 1);
        put_u32(bytes + 8, (uint32_t)stamp);
        put_u32(bytes + 12, (uint32_t)(stamp >> 32));
    }
    return message;
}

// Return the message of a datagram if it is the next one of a topic that is followed. If not, or with
// an exception, return NULL.
PyObject *take_small(PyObject *datagram, PyObject *sender, const struct small_topics *small)
{
    const char *head = PyBytes_AS_STRING(datagram);
    Py_ssize_t size = PyBytes_GET_SIZE(datagram), offset = size > 1 ? (unsigned char)head[1] : 0;
    if (offset < HEADER_MIN || size < offset) return NULL;
    PyObject *key = Py_BuildValue("(Oy#y#)", sender, head, (Py_ssize_t)SEQ_NUMBER,
                                  head + TOPIC_SIZE, offset - TOPIC_SIZE);
    PyObject *row = key ? PyDict_GetItemWithError(small->table, key) : NULL;
    Py_XDECREF(key);
    return row ? continued(row, datagram, small) : NULL;
}

// Return the `WholeMessage` of a batch if all its parts lie in the block, in order, and it is the
// upcoming one. If not, or with an exception, return NULL. `row` is an `UpcomingMessage`.
PyObject *take_whole(const struct part_batch *batch, PyObject *block, PyObject *row,
                     const struct small_topics *small)
{
    const unsigned char *head = batch->header;
    int parts = (int)batch->arrived.len;
    if (batch->is_open || batch->ranges_count != 1 || batch->ranges[0].first ||
        batch->ranges[0].count != parts || batch->kept || batch->nack_bitmap_size || batch->uncredited)
        return NULL;
    if (!PyTuple_Check(row) || PyTuple_GET_SIZE(row) != 7) {
        PyErr_SetString(PyExc_TypeError, "this is no upcoming message");
        return NULL;
    }
    struct upcoming next = {(uint32_t)PyLong_AsUnsignedLong(PyTuple_GET_ITEM(row, 1)),
                            PyObject_IsTrue(PyTuple_GET_ITEM(row, 2)),
                            PyLong_AsLongLong(PyTuple_GET_ITEM(row, 3))};
    if (PyErr_Occurred() || !is_next(head, &next)) return NULL;
    Py_ssize_t body_size = (parts - 1) * batch->part_size + batch->last_size;
    PyObject *view = PyMemoryView_FromObject(block);
    PyObject *part = view ? PySequence_GetSlice(view, 0, body_size) : NULL;
    PyObject *body = part ? PyObject_CallMethod(part, "toreadonly", NULL) : NULL;
    Py_XDECREF(view);
    Py_XDECREF(part);
    PyObject *record, *message = delivered(head, PyTuple_GET_ITEM(row, 0),
                                           PySequence_Fast_ITEMS(row) + 4, body,
                                           body_size + parts * batch->predicted.len, small, &record);
    return message ? Py_BuildValue("Ny#iN", message, head, batch->predicted.len, batch->credits,
                                   record) : NULL;
}

int are_small_topics(const struct small_topics *small)
{
    PyObject *types[] = {small->message_type, small->record_type};
    for (int i = 0; i < 2; i++) {
        PyTypeObject *type = (PyTypeObject *)types[i];
        if (PyType_Check(types[i]) && PyType_IsSubtype(type, &PyTuple_Type)) continue;
        PyErr_SetString(PyExc_TypeError, "messages and records are named tuples");
        return 0;
    }
    return 1;
}
