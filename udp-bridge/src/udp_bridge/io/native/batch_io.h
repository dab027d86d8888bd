// SPDX-License-Identifier: Apache-2.0
// Shared by the files of the extension `_batch_io`: the wire format, batches of parts, the mailbox.
#ifndef UDP_BRIDGE_BATCH_IO_H
#define UDP_BRIDGE_BATCH_IO_H
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

#if PY_VERSION_HEX < 0x030A0000
static inline PyObject *Py_NewRef(PyObject *object)
{
    Py_INCREF(object);
    return object;
}
#endif

// Offsets in a header, message types and sizes of the wire format; see PROTOCOL.md.
enum {
    SEQ_NUMBER = 2, PART_NUMBER = 6, PARTS_MAX = 7, TIME = 8, TIME_NSEC = 12, TOPIC_SIZE = 16,
    NAMES = 18, HEADER_MIN = 20, HEADER_ROOM = 264, MAX_PARTS = 255,
    CONTROL = 64, RESEND = 65, REQUEST = 1, CREDIT_SIZE = 12, CREDIT_SHARE = 8, OFFER = 0,
    OFFER_SIZE = 8, REQUEST_SIZE = 8, BITMAP_SIZE = 32, WINDOW_SHARE = 2
};

enum {
    DATAGRAMS_PER_CALL = 64, // of sendmmsg
    MAX_ARRIVAL_RANGES = 64, // of a received batch
    MAX_BATCH_NANOS = 20000000, // duration of a received batch after its first datagram
    SPIN_NANOS = 50000, // longest wait for a part without sleeping
    MAX_SPIN_NANOS = 150000, // all those of a batch that were in vain
    CREDIT_NANOS = 200000, // wait of the Credit for a whole message
    MAILBOX_SIZE = 64, // Credits
    MAX_RANGES = 16, // in flight with a delegated send
    NANOS = 1000000000
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

// Parts of a message to send.
struct parts {
    struct sockaddr_in to;
    const unsigned char *packed; // the header of part 0
    char *body;
    Py_ssize_t packed_size, body_size, size; // size: of each part; the last may be smaller
};

// The rest of a message, sent as Credits arrive. Bytes in flight are counted as in
// `flow_control.py`.
struct delegated_send {
    struct parts parts;
    int next, end, sent, is_over; // numbers of parts; sent: since it was delegated
    int64_t cost, in_flight_bytes, window_bytes;
    int in_flight_count;
    struct part_range {
        uint32_t seq_number;
        int first, count;
        int64_t cost, last_cost;
    } in_flight[MAX_RANGES]; // oldest first; the last one is of the message itself
};

// Credits of one peer and topic that wait for the sender. It keeps none while it is all zero.
struct mailbox {
    struct sockaddr_in from;
    unsigned char pattern[HEADER_ROOM + CREDIT_SIZE]; // a Credit; its numbers are ignored
    int pattern_size, is_awaited, count; // is_awaited: the next Credit must wake the sender
    struct kept_credit {
        uint32_t seq_number, part_number, receive_buffer;
    } credits[MAILBOX_SIZE];
    struct due_credit { // of the receiving thread alone, without the lock
        struct sockaddr_in to;
        unsigned char datagram[HEADER_ROOM + CREDIT_SIZE];
        size_t size; // 0: none is due
    } due;
    struct delegated_send send; // Python keeps its memory until it is reclaimed
    int is_sending; // the receiving thread sends it, without the lock
    pthread_cond_t sending_ended;
    pthread_mutex_t lock; // never held during a system call or while waiting for another lock
};

// One call of `receive`: the predicted parts, and what was received.
struct part_batch {
    Py_buffer rest, block, predicted, mailbox; // rest: for other datagrams; predicted: the header
    Py_buffer arrived; // for each part whether it arrived before
    unsigned char has_arrived[MAX_PARTS]; // before or in this batch
    unsigned char header[HEADER_ROOM]; // of the part that arrived first
    struct sockaddr_in sender, source; // sender: of the parts; source: of the newest datagram
    Py_ssize_t part_size, last_size; // last_size: body bytes of the message's last part
    int fd, next, missing; // next: the predicted part; missing: number of parts
    int is_open; // a part of the message arrived before: all fields of the header must be equal
    struct {
        int first, count;
    } ranges[MAX_ARRIVAL_RANGES]; // parts in order of arrival
    int ranges_count, error, is_delegated_done;
    int credits, kept; // sent; put into the mailbox
    unsigned long long kept_bytes;
    unsigned int control_number, receive_buffer;
    unsigned long long uncredited;
    long long nack_due_nanos; // the batch ends then; 0: never
    long long debounce_nanos; // from the detection of a gap to its Request; 0: never
    int may_nack; // one Request may be sent when it is due
    unsigned int goodput; // for that Request
    long long nack_nanos; // when it was sent, and for which parts
    unsigned char nack_bitmap[BITMAP_SIZE];
    int nack_bitmap_size;
    long long spin_nanos; // left for waits without sleeping, in vain
    long long drops; // reported by the kernel; -1 if it did not
    PyThreadState *thread; // while the interpreter lock is released
};

// Topics of small messages, as in `small_topics.py`.
struct small_topics {
    PyObject *table, *delivered; // a dict and a list
    PyObject *message_type, *record_type; // named tuples
};

static inline char *slot_of(const struct part_batch *batch, int number)
{
    return (char *)batch->block.buf + number * batch->part_size;
}

int to_address(const char *host, int port, struct sockaddr_in *address);
int lies_in_body(const struct parts *parts, int first, int count);
int send_range(int fd, const struct parts *parts, int first, int count, int *error);
void copy_datagram(const struct part_batch *batch, const unsigned char *head, Py_ssize_t size,
                   char *to);
struct mailbox *mailbox_in(const Py_buffer *memory);
int are_small_topics(const struct small_topics *small);
PyObject *take_whole(const struct part_batch *batch, PyObject *row,
                     const struct small_topics *small);
PyObject *take_small(PyObject *datagram, PyObject *sender, const struct small_topics *small);
int keep_credit(struct part_batch *batch, const unsigned char *head, Py_ssize_t size);

// Functions of the module; arguments and results are documented at the definitions.
PyObject *send_parts(PyObject *self, PyObject *args);
PyObject *send_small(PyObject *self, PyObject *args);
PyObject *receive(PyObject *self, PyObject *args);
PyObject *make_mailbox(PyObject *self, PyObject *args);
PyObject *keep(PyObject *self, PyObject *args);
PyObject *collect(PyObject *self, PyObject *args);
PyObject *delegate(PyObject *self, PyObject *args);
PyObject *reclaim(PyObject *self, PyObject *args);
PyObject *publish(PyObject *self, PyObject *const *args, Py_ssize_t count);

#endif
