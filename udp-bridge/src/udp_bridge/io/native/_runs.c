// SPDX-License-Identifier: Apache-2.0
// The module `_runs`: what `runs.py` calls, by name.
#include "_runs.h"

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
