// SPDX-License-Identifier: Apache-2.0
// A run: parts of one message that are received one after the other, and what is to be said of them.
#ifndef UDP_BRIDGE_RUN_H
#define UDP_BRIDGE_RUN_H
#include "_runs.h"

// What is expected next, and what came of it.
struct run {
    Py_buffer rest, block, head, parking; // rest: for what has no other place; head: as it is expected
    Py_buffer arrived;               // for each part whether it is in
    unsigned char is_in[MOST_PARTS]; // the same, and with what came in this run
    unsigned char came[HEADER_ROOM]; // the header of the first part; behind it only stray ones
    struct sockaddr_in sender, from; // of the parts; of the last datagram
    Py_ssize_t part_size, last_size; // last_size: body bytes of the message's last part
    int fd, next, missing;           // the part that is expected next; how many are missing
    int is_open;                     // a part of the message was taken before: all must be alike
    struct {
        int first, count;
    } rows[ROWS]; // parts that came, by order; those in a row together
    int rows_count, credits, error, parked, is_over; // is_over: an order was carried out, or failed
    unsigned long long parked_bytes;
    unsigned int control_number, receive_buffer;
    unsigned long long uncredited;
    long long due_nanos; // nothing is waited for longer behind a part; 0: it is
    long long patience_nanos; // so long behind a gap it is due; 0: never
    int may_ask;              // for gaps, when that is due
    unsigned int goodput;     // to be told then
    long long asked_nanos;    // when that was done, and for what; the bitmap is of so many bytes
    unsigned char asked[BITMAP_SIZE];
    int asked_size;
    long long drops; // that the kernel told of; -1 where it did not
    PyThreadState *thread; // while the interpreter is given away
};

static inline char *place_of(const struct run *run, int number)
{
    return (char *)run->block.buf + number * run->part_size;
}

void gather(const struct run *run, const unsigned char *head, Py_ssize_t size, char *to);
int send_credit(struct run *run, const unsigned char *head);
void send_request(struct run *run, int end);
int is_offer(const struct run *run, const unsigned char *head, Py_ssize_t size);
int keep_credit(struct run *run, const unsigned char *head, Py_ssize_t size);

#endif
