// SPDX-License-Identifier: Apache-2.0
// Small messages that are next in order, as `SmallTopics.take` finds them; see `small_topics.py`.
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

// Return the message that continues a topic, and append it to the delivered ones. `row` is a tuple:
// topic, state, msg_type, name, link.
static PyObject *continued(PyObject *row, PyObject *datagram, const struct small_topics *small)
{
    PyObject *state = PyTuple_Check(row) && PyTuple_GET_SIZE(row) == 5 ? PyTuple_GET_ITEM(row, 1) : NULL;
    if (!state || !PyByteArray_Check(state) || PyByteArray_GET_SIZE(state) != STATE_SIZE) {
        PyErr_SetString(PyExc_TypeError, "this is no small topic");
        return NULL;
    }
    const unsigned char *head = (unsigned char *)PyBytes_AS_STRING(datagram);
    unsigned char *bytes = (unsigned char *)PyByteArray_AS_STRING(state);
    uint32_t number = u32(head + SEQ_NUMBER), nsec = u32(head + TIME_NSEC);
    int64_t stamp = (int32_t)u32(head + TIME) * (int64_t)NANOS + nsec;
    int64_t last_stamp = (int64_t)(u32(bytes + 8) | (uint64_t)u32(bytes + 12) << 32);
    if (number != u32(bytes) || head[PART_NUMBER] || head[PARTS_MAX] != 1 || nsec >= NANOS ||
        (bytes[4] && stamp < last_stamp))
        return NULL;
    PyObject *whole = PyMemoryView_FromObject(datagram), *record = NULL;
    PyObject *fields[] = {
        Py_NewRef(PyTuple_GET_ITEM(row, 2)), Py_NewRef(PyTuple_GET_ITEM(row, 3)),
        Py_NewRef(PyTuple_GET_ITEM(row, 4)), PyLong_FromLongLong(stamp),
        PyLong_FromUnsignedLong(number),
        whole ? PySequence_GetSlice(whole, head[1], PyBytes_GET_SIZE(datagram)) : NULL,
        PyLong_FromLong(1),
    };
    Py_XDECREF(whole);
    PyObject *message = named_tuple(small->message_type, 7, fields);
    if (message) {
        Py_ssize_t size = PyBytes_GET_SIZE(datagram);
        PyObject *values[] = {
            Py_NewRef(PyTuple_GET_ITEM(row, 0)), Py_BuildValue("(IL)", number, (long long)stamp),
            PyLong_FromSsize_t(size - head[1]), PyLong_FromLong(1), PyLong_FromSsize_t(size),
            PyLong_FromLongLong(now_nanos()),
        };
        record = named_tuple(small->record_type, 6, values);
    }
    if (record && !PyList_Append(small->delivered, record)) {
        put_u32(bytes, number + 1);
        put_u32(bytes + 8, (uint32_t)stamp);
        put_u32(bytes + 12, (uint32_t)((uint64_t)stamp >> 32));
    } else {
        Py_CLEAR(message);
    }
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
