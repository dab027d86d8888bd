// SPDX-License-Identifier: Apache-2.0
// Small messages that are next in order, as `SmallTopics.take` finds them; see `small_topics.py`.
#include "batch_io.h"

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

// Read an integer attribute; return false, with an exception, if there is none.
static int read_attribute(PyObject *object, const char *name, long long *value)
{
    PyObject *found = PyObject_GetAttrString(object, name);
    *value = found ? PyLong_AsLongLong(found) : -1;
    Py_XDECREF(found);
    return !PyErr_Occurred();
}

static int write_attribute(PyObject *object, const char *name, PyObject *value)
{
    int is_set = value && !PyObject_SetAttrString(object, name, value);
    Py_XDECREF(value);
    return is_set;
}

// Return the message that continues a topic, and append it to the delivered ones.
static PyObject *continued(PyObject *topic, PyObject *datagram, const struct small_topics *small)
{
    const unsigned char *head = (unsigned char *)PyBytes_AS_STRING(datagram);
    Py_ssize_t size = PyBytes_GET_SIZE(datagram);
    long long next, newest, is_ordered;
    uint32_t number = u32(head + SEQ_NUMBER), nsec = u32(head + TIME_NSEC);
    long long stamp = (int32_t)u32(head + TIME) * (long long)NANOS + nsec;
    if (!read_attribute(topic, "next_number", &next) ||
        !read_attribute(topic, "stamp_nanos", &newest) ||
        !read_attribute(topic, "is_stamp_ordered", &is_ordered))
        return NULL;
    if (number != next || head[PART_NUMBER] || head[PARTS_MAX] != 1 || nsec >= NANOS ||
        (is_ordered && stamp < newest))
        return NULL;
    PyObject *key = PyObject_GetAttrString(topic, "key"), *whole = PyMemoryView_FromObject(datagram);
    PyObject *message = NULL, *record = NULL;
    if (key && whole && PyTuple_Check(key) && PyTuple_GET_SIZE(key) == 2) {
        PyObject *fields[] = {
            Py_NewRef(PyTuple_GET_ITEM(key, 0)), Py_NewRef(PyTuple_GET_ITEM(key, 1)),
            PyObject_GetAttrString(topic, "link"), PyLong_FromLongLong(stamp),
            PyLong_FromUnsignedLong(number), PySequence_GetSlice(whole, head[1], size),
            PyLong_FromLong(1),
        };
        message = named_tuple(small->message_type, 7, fields);
    }
    Py_XDECREF(key);
    Py_XDECREF(whole);
    if (message) {
        PyObject *fields[] = {Py_NewRef(topic), Py_NewRef(message), PyLong_FromSsize_t(size),
                              PyLong_FromLongLong(now_nanos())};
        record = named_tuple(small->record_type, 4, fields);
    }
    if (!record || PyList_Append(small->delivered, record) ||
        !write_attribute(topic, "next_number", PyLong_FromUnsignedLong(number + 1)) ||
        !write_attribute(topic, "stamp_nanos", PyLong_FromLongLong(stamp)))
        Py_CLEAR(message);
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
    PyObject *topic = key ? PyDict_GetItemWithError(small->table, key) : NULL;
    Py_XDECREF(key);
    return topic ? continued(topic, datagram, small) : NULL;
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
