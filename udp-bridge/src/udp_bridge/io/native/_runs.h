// SPDX-License-Identifier: Apache-2.0
// What the files of `_runs` share: words of the wire, parts to send, credits that wait.
#ifndef UDP_BRIDGE_RUNS_H
#define UDP_BRIDGE_RUNS_H
#define PY_SSIZE_T_CLEAN
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <Python.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdint.h>
#include <sys/socket.h>
#include <time.h>

enum {
    SEQ_NUMBER = 2, PART_NUMBER = 6, PARTS_MAX = 7, TIME = 8, TIME_NSEC = 12, TOPIC_SIZE = 16,
    NAMES = 18, HEADER_MIN = 20, HEADER_ROOM = 264, MOST_PARTS = 255,
    CONTROL = 64, RESEND = 65, REQUEST = 1, CREDIT_SIZE = 12, CREDIT_SHARE = 8, OFFER = 0,
    OFFER_SIZE = 8, REQUEST_SIZE = 8, BITMAP_SIZE = 32, BATCH = 64, NANOS = 1000000000, PARKED = 64,
    FLIGHTS = 16, WINDOW_SHARE = 2,
    ROWS = 64, LONGEST_NANOS = 20000000 // of a run, behind its first datagram; then Python looks around
};

static inline uint32_t u32(const unsigned char *at)
{
    return at[0] | at[1] << 8 | at[2] << 16 | (uint32_t)at[3] << 24;
}

static inline void put_u32(unsigned char *at, uint32_t value)
{
    for (int i = 0; i < 4; i++) at[i] = value >> 8 * i & 255;
}

static inline int64_t now_nanos(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

// Parts of a message, and where they are to go.
struct parts {
    struct sockaddr_in to;
    const unsigned char *packed; // the header of part 0
    char *body;
    Py_ssize_t packed_size, body_size, size; // size: of a part, of which the last may lack some
};

// The rest of a message, to be sent as credits come. What is under way is reckoned as in `flow`.
struct order {
    struct parts parts;
    int next, end, sent, is_over; // parts; sent: since it was given
    int64_t cost, in_flight, window;
    int flights_count;
    struct flight {
        uint32_t seq_number;
        int first, count;
        int64_t cost, last_cost;
    } flights[FLIGHTS]; // oldest first; the last one is of the message itself
};

// Credits of one peer for one topic that wait for the sender. All zero it takes none.
struct parking {
    struct sockaddr_in from;
    unsigned char like[HEADER_ROOM + CREDIT_SIZE]; // a credit as it looks but for its numbers
    int like_size, is_awaited, count;              // is_awaited: the sender has to be woken
    struct parked {
        uint32_t seq_number, part_number, receive_buffer;
    } rows[PARKED];
    struct order order; // its bytes are kept by who gave it, until it is taken back
    int is_sending;     // the thread that receives sends of it, without the lock
    pthread_cond_t rest; // it no longer does
    pthread_mutex_t lock; // whoever holds it waits for nothing: no other lock, no call of the kernel
};

int to_address(const char *host, int port, struct sockaddr_in *address);
int is_fit(const struct parts *parts, int first, int count);
int send_some(int fd, const struct parts *parts, int first, int count, int *error);
struct parking *parking_in(const Py_buffer *memory);
int make_room(struct order *order, const unsigned char *credit);

// The functions of the module, each with what it takes and returns where it is defined.
PyObject *send_parts(PyObject *self, PyObject *args);
PyObject *make_parking(PyObject *self, PyObject *args);
PyObject *park(PyObject *self, PyObject *args);
PyObject *take_parked(PyObject *self, PyObject *args);
PyObject *give_order(PyObject *self, PyObject *args);
PyObject *take_back(PyObject *self, PyObject *args);
PyObject *receive(PyObject *self, PyObject *args);

#endif
