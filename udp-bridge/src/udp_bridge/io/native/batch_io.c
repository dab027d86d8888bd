// SPDX-License-Identifier: Apache-2.0
// The extension module `_batch_io`, and batches of parts that are sent in one system call.
#include "batch_io.h"

#include <arpa/inet.h>
#include <errno.h>
#include <string.h>
#include <sys/uio.h>

// Convert `(host, port)`; return false, with an exception, if it is no numeric address.
int to_address(const char *host, int port, struct sockaddr_in *address)
{
    memset(address, 0, sizeof *address);
    address->sin_family = AF_INET;
    address->sin_port = htons((uint16_t)port);
    if (inet_pton(AF_INET, host, &address->sin_addr) == 1 && 0 <= port && port <= 65535) return 1;
    PyErr_SetString(PyExc_ValueError, "no numeric IPv4 address with a port");
    return 0;
}

// Return whether `count` parts from `first` on lie in the body; if not, with an exception.
int lies_in_body(const struct parts *parts, int first, int count)
{
    if (parts->packed_size >= HEADER_MIN && parts->packed_size < HEADER_ROOM && parts->size > 0 &&
        first >= 0 && count > 0 && first + (int64_t)count <= MAX_PARTS &&
        parts->size <= PY_SSIZE_T_MAX / HEADER_ROOM &&
        (first + count - 1) * parts->size < parts->body_size + (parts->body_size == 0))
        return 1;
    PyErr_SetString(PyExc_ValueError, "the parts do not lie in the body");
    return 0;
}

// Send parts in order until the kernel does not take one. Return how many were sent.
int send_range(int fd, const struct parts *parts, int first, int count, int *error)
{
    unsigned char heads[DATAGRAMS_PER_CALL][HEADER_ROOM];
    struct iovec io[DATAGRAMS_PER_CALL][2];
    struct mmsghdr messages[DATAGRAMS_PER_CALL];
    int sent = 0;
    *error = 0;
    while (sent < count && !*error) {
        int most = count - sent < DATAGRAMS_PER_CALL ? count - sent : DATAGRAMS_PER_CALL;
        memset(messages, 0, sizeof *messages * most);
        for (int i = 0; i < most; i++) {
            Py_ssize_t start = (first + sent + i) * parts->size, left = parts->body_size - start;
            memcpy(heads[i], parts->packed, parts->packed_size);
            heads[i][PART_NUMBER] = (unsigned char)(first + sent + i);
            io[i][0] = (struct iovec){heads[i], parts->packed_size};
            io[i][1] = (struct iovec){parts->body + start, left < parts->size ? left : parts->size};
            messages[i].msg_hdr = (struct msghdr){.msg_name = (void *)&parts->to,
                                              .msg_namelen = sizeof parts->to,
                                              .msg_iov = io[i], .msg_iovlen = 2};
        }
        int taken = sendmmsg(fd, messages, most, 0);
        if (taken > 0) sent += taken;
        else if (taken == 0 || errno != EINTR) *error = taken ? errno : EAGAIN;
    }
    return sent;
}

// send(fd, (host, port), header of part 0, body, part size, first, count) -> sent, errno or 0
PyObject *send_parts(PyObject *self, PyObject *args)
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
    int is_right = lies_in_body(&parts, first, count) && to_address(host, port, &parts.to);
    if (is_right) {
        Py_BEGIN_ALLOW_THREADS;
        sent = send_range(fd, &parts, first, count, &error);
        Py_END_ALLOW_THREADS;
    }
    PyBuffer_Release(&packed);
    PyBuffer_Release(&body);
    return is_right ? Py_BuildValue("ii", sent, error) : NULL;
}

// Stamp the header of part 0; return false if a header or a stamp is none.
static int stamped(unsigned char *head, const Py_buffer *packed, unsigned int seq_number,
                   long long stamp)
{
    long long nsec = (stamp % NANOS + NANOS) % NANOS, sec = (stamp - nsec) / NANOS;
    if (packed->len < HEADER_MIN || packed->len >= HEADER_ROOM) {
        PyErr_SetString(PyExc_ValueError, "this is no header");
        return 0;
    }
    memcpy(head, packed->buf, packed->len);
    put_u32(head + SEQ_NUMBER, seq_number);
    put_u32(head + TIME, (uint32_t)sec);
    put_u32(head + TIME_NSEC, (uint32_t)nsec);
    return sec == (int32_t)sec;
}

// send_small(fd, (host, port), header of part 0, most, seq_number, stamp in ns, body) -> body bytes
//
// Sends a message of one part of at most `most` bytes under this number and stamp, without waiting:
// releasing the interpreter would take longer. -1: it was not sent.
PyObject *send_small(PyObject *self, PyObject *args)
{
    int fd, port;
    const char *host;
    unsigned int seq_number;
    long long stamp;
    Py_ssize_t most;
    Py_buffer packed, body;
    unsigned char head[HEADER_ROOM];
    struct sockaddr_in to;
    (void)self;
    if (!PyArg_ParseTuple(args, "i(si)y*nILy*", &fd, &host, &port, &packed, &most, &seq_number,
                          &stamp, &body))
        return NULL;
    Py_ssize_t sent = -1, size = packed.len + body.len;
    if (stamped(head, &packed, seq_number, stamp) && to_address(host, port, &to) &&
        body.len <= most) {
        struct iovec io[2] = {{head, packed.len}, {body.buf, body.len}};
        struct msghdr message = {.msg_name = &to, .msg_namelen = sizeof to, .msg_iov = io,
                                 .msg_iovlen = 2};
        sent = sendmsg(fd, &message, MSG_DONTWAIT);
    }
    size = sent == size ? body.len : -1;
    PyBuffer_Release(&packed);
    PyBuffer_Release(&body);
    return PyErr_Occurred() ? NULL : PyLong_FromSsize_t(size);
}

// send_large(fd, (host, port), header of part 0, bytes of the body, part size, number of parts,
// seq_number, stamp in ns, body) -> number of parts sent
//
// Sends a message of several parts under this number and stamp. -1: nothing was sent, because the body
// has another size. A part that the kernel does not take is tried twice.
PyObject *send_large(PyObject *self, PyObject *args)
{
    int fd, port, count, next = 0, sent = 0, error = 0, is_again = 0;
    const char *host;
    unsigned int seq_number;
    long long stamp;
    Py_ssize_t body_size;
    Py_buffer packed, body;
    unsigned char head[HEADER_ROOM];
    struct parts parts;
    (void)self;
    if (!PyArg_ParseTuple(args, "i(si)y*nniILy*", &fd, &host, &port, &packed, &body_size,
                          &parts.size, &count, &seq_number, &stamp, &body))
        return NULL;
    parts.packed = head, parts.packed_size = packed.len;
    parts.body = body.buf, parts.body_size = body.len;
    int is_right = body.len == body_size && stamped(head, &packed, seq_number, stamp) &&
                   lies_in_body(&parts, 0, count) && to_address(host, port, &parts.to);
    if (is_right) {
        Py_BEGIN_ALLOW_THREADS;
        while (next < count) {
            int some = send_range(fd, &parts, next, count - next, &error);
            sent += some;
            is_again = error && !(is_again && !some); // it may report an earlier datagram
            next += some + (error && !is_again);
        }
        Py_END_ALLOW_THREADS;
    }
    PyBuffer_Release(&packed);
    PyBuffer_Release(&body);
    return PyErr_Occurred() ? NULL : PyLong_FromLong(is_right ? sent : -1);
}

static PyMethodDef methods[] = {
    {"send_large", send_large, METH_VARARGS, "Send a message of several parts."},
    {"send_small", send_small, METH_VARARGS, "Send a message of one part."},
    {"send", send_parts, METH_VARARGS, "Send parts of a message."},
    {"receive", receive, METH_VARARGS, "Receive predicted parts, and one other datagram."},
    {"mailbox", make_mailbox, METH_NOARGS, "Return the memory of a mailbox."},
    {"keep", keep, METH_VARARGS, "Keep Credits that match a pattern."},
    {"collect", collect, METH_VARARGS, "Return and remove the kept Credits."},
    {"delegate", delegate, METH_VARARGS, "Send the rest of a message as Credits arrive."},
    {"reclaim", reclaim, METH_VARARGS, "End that; return how many parts were sent."},
    {"publish", (PyCFunction)(void (*)(void))publish, METH_FASTCALL, "Publish a body in ROS 2."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "_batch_io", "See udp_socket.py.", 0, methods, NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__batch_io(void)
{
    return PyModule_Create(&module);
}
