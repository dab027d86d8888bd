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

static int64_t stamp_of(const unsigned char *head)
{
    return (int32_t)u32(head + TIME) * (int64_t)NANOS + u32(head + TIME_NSEC);
}

// Return the `_STATE` of a row, a tuple: source, state, msg_type, name, link. NULL with an exception.
static unsigned char *state_of(PyObject *row)
{
    PyObject *state = PyTuple_Check(row) && PyTuple_GET_SIZE(row) == 5 ? PyTuple_GET_ITEM(row, 1) : NULL;
    if (state && PyByteArray_Check(state) && PyByteArray_GET_SIZE(state) == STATE_SIZE)
        return (unsigned char *)PyByteArray_AS_STRING(state);
    PyErr_SetString(PyExc_TypeError, "this is no row of a topic");
    return NULL;
}

static int is_next(const unsigned char *head, const unsigned char *state)
{
    int64_t last_stamp = (int64_t)(u32(state + 8) | (uint64_t)u32(state + 12) << 32);
    return u32(head + SEQ_NUMBER) == u32(state) && u32(head + TIME_NSEC) < NANOS &&
           (!state[4] || stamp_of(head) >= last_stamp);
}

// Return the message of a header and a body, which is given away, and its record; then the next one
// of the row is awaited. `size` is that of all its datagrams.
static PyObject *delivered(const unsigned char *head, PyObject *row, PyObject *body, Py_ssize_t size,
                           const struct small_topics *small, PyObject **record)
{
    unsigned char *state = state_of(row);
    PyObject *const *columns = PySequence_Fast_ITEMS(row);
    uint32_t number = u32(head + SEQ_NUMBER);
    int parts = head[PARTS_MAX];
    int64_t stamp = stamp_of(head);
    PyObject *fields[] = {
        Py_NewRef(columns[2]), Py_NewRef(columns[3]), Py_NewRef(columns[4]),
        PyLong_FromLongLong(stamp), PyLong_FromUnsignedLong(number), body, PyLong_FromLong(parts),
    };
    PyObject *values[] = {
        Py_NewRef(columns[0]), Py_BuildValue("(IL)", number, (long long)stamp),
        PyLong_FromSsize_t(size - parts * head[1]), PyLong_FromLong(parts),
        PyLong_FromSsize_t(size), PyLong_FromLongLong(now_nanos()),
    };
    PyObject *message = named_tuple(small->message_type, 7, fields);
    *record = named_tuple(small->record_type, 6, values);
    if (!message || !*record) {
        Py_CLEAR(message);
        Py_CLEAR(*record);
        return NULL;
    }
    put_u32(state, number + 1);
    put_u32(state + 8, (uint32_t)stamp);
    put_u32(state + 12, (uint32_t)((uint64_t)stamp >> 32));
    return message;
}

// Return the message that continues a topic, and append its record to the delivered ones.
static PyObject *continued(PyObject *row, PyObject *datagram, const struct small_topics *small)
{
    const unsigned char *head = (unsigned char *)PyBytes_AS_STRING(datagram), *state = state_of(row);
    if (!state || head[PART_NUMBER] || head[PARTS_MAX] != 1 || !is_next(head, state)) return NULL;
    Py_ssize_t size = PyBytes_GET_SIZE(datagram);
    PyObject *whole = PyMemoryView_FromObject(datagram), *record;
    PyObject *body = whole ? PySequence_GetSlice(whole, head[1], size) : NULL;
    Py_XDECREF(whole);
    PyObject *message = delivered(head, row, body, size, small, &record);
    if (message && PyList_Append(small->delivered, record)) Py_CLEAR(message);
    Py_XDECREF(record);
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

// Return the `WholeMessage` of a batch if all its parts lie in the block, in order, and it continues
// the topic of this row. If not, or with an exception, return NULL.
PyObject *take_whole(const struct part_batch *batch, PyObject *row, const struct small_topics *small)
{
    const unsigned char *head = batch->header, *state = state_of(row);
    int parts = (int)batch->arrived.len;
    if (!state || batch->is_open || batch->ranges_count != 1 || batch->ranges[0].first ||
        batch->ranges[0].count != parts || batch->kept || batch->nack_bitmap_size ||
        batch->uncredited || !is_next(head, state))
        return NULL;
    Py_ssize_t body_size = (parts - 1) * batch->part_size + batch->last_size;
    PyObject *view = PyMemoryView_FromObject(batch->block.obj);
    PyObject *part = view ? PySequence_GetSlice(view, 0, body_size) : NULL;
    PyObject *body = part ? PyObject_CallMethod(part, "toreadonly", NULL) : NULL;
    Py_XDECREF(view);
    Py_XDECREF(part);
    PyObject *record, *message = delivered(
        head, row, body, body_size + parts * batch->predicted.len, small, &record);
    if (!message) return NULL;
    return Py_BuildValue("Ny#iN", message, head, batch->predicted.len, batch->credits, record);
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
