// SPDX-License-Identifier: Apache-2.0
// Parts of a message go to the kernel in one call, headers and slices of the body side by side.
#include "_runs.h"

#include <arpa/inet.h>
#include <errno.h>
#include <string.h>
#include <sys/uio.h>

// An address as `(host, port)`; false, with an exception, where it is none.
int to_address(const char *host, int port, struct sockaddr_in *address)
{
    memset(address, 0, sizeof *address);
    address->sin_family = AF_INET;
    address->sin_port = htons((uint16_t)port);
    if (inet_pton(AF_INET, host, &address->sin_addr) == 1 && 0 <= port && port <= 65535) return 1;
    PyErr_SetString(PyExc_ValueError, "no numeric IPv4 address with a port");
    return 0;
}

// Whether so many parts from `first` on lie in the body; an exception says so where they do not.
int is_fit(const struct parts *parts, int first, int count)
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
int send_some(int fd, const struct parts *parts, int first, int count, int *error)
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
