// SPDX-License-Identifier: Apache-2.0
// Publishing in ROS 2 from the memory in which a body was received.
#include "batch_io.h"

// `rcl_serialized_message_t`
struct serialized_message {
    void *buffer;
    size_t length, capacity;
    void *allocator[5];
};

typedef int publish_function(const void *publisher, const struct serialized_message *, void *);

// publish(address of rcl_publish_serialized_message, address of an rcl_publisher_t, body) -> code
//
// The middleware copies the body before it returns; other threads may use the interpreter meanwhile.
// The caller keeps the publisher alive.
PyObject *publish(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    Py_buffer body;
    int code;
    (void)self;
    if (count != 3) {
        PyErr_SetString(PyExc_TypeError, "publish takes a function, a publisher and a body");
        return NULL;
    }
    publish_function *function = (publish_function *)PyLong_AsVoidPtr(args[0]);
    void *publisher = PyLong_AsVoidPtr(args[1]);
    if (PyErr_Occurred() || PyObject_GetBuffer(args[2], &body, PyBUF_SIMPLE)) return NULL;
    struct serialized_message message = {body.buf, (size_t)body.len, (size_t)body.len, {NULL}};
    Py_BEGIN_ALLOW_THREADS;
    code = function(publisher, &message, NULL);
    Py_END_ALLOW_THREADS;
    PyBuffer_Release(&body);
    return PyLong_FromLong(code);
}
