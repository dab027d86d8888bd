// SPDX-License-Identifier: Apache-2.0
// Credits that come while a run is received: kept for the sender, or carried out at once.
#include "_run.h"

#include <string.h>

// Send so many parts of the order. The caller holds the lock, and again when this returns.
static void go_on(struct run *run, struct parking *parking, int count)
{
    struct order *order = &parking->order;
    int error;
    parking->is_sending = 1; // so nobody else changes the order
    pthread_mutex_unlock(&parking->lock);
    if (!run->thread) run->thread = PyEval_SaveThread(); // others may compute meanwhile
    int sent = send_some(run->fd, &order->parts, order->next, count, &error);
    pthread_mutex_lock(&parking->lock);
    parking->is_sending = 0;
    pthread_cond_broadcast(&parking->rest);
    order->flights[order->flights_count - 1].count += sent;
    order->in_flight += sent * order->cost;
    order->next += sent;
    order->sent += sent;
    order->is_over = error || order->next == order->end;
    run->is_over = order->is_over;
}

// Keep a datagram for the sender, if it is a credit that can wait; return whether it was kept.
int keep_credit(struct run *run, const unsigned char *head, Py_ssize_t size)
{
    struct parking *parking = run->parking.buf;
    unsigned char credit[HEADER_ROOM + CREDIT_SIZE];
    int is_kept = 0, count = 0;
    if (size < HEADER_MIN + CREDIT_SIZE || size > (Py_ssize_t)sizeof credit) return 0;
    gather(run, head, size, (char *)credit);
    const unsigned char *body = credit + size - CREDIT_SIZE;
    pthread_mutex_lock(&parking->lock);
    const unsigned char *like = parking->like;
    if (size == parking->like_size && parking->count < PARKED &&
        run->from.sin_addr.s_addr == parking->from.sin_addr.s_addr &&
        run->from.sin_port == parking->from.sin_port && !memcmp(credit, like, SEQ_NUMBER) &&
        !memcmp(credit + PART_NUMBER, like + PART_NUMBER, TIME - PART_NUMBER) &&
        u32(credit + TIME_NSEC) < NANOS &&
        !memcmp(credit + TOPIC_SIZE, like + TOPIC_SIZE, size - CREDIT_SIZE - TOPIC_SIZE) &&
        !memcmp(body, like + size - CREDIT_SIZE, 2) &&
        (!parking->is_awaited || (count = make_room(&parking->order, body)))) {
        parking->rows[parking->count++] = (struct parked){u32(body + 4), body[2], u32(body + 8)};
        is_kept = 1;
        if (count) go_on(run, parking, count);
    }
    pthread_mutex_unlock(&parking->lock);
    run->parked += is_kept;
    run->parked_bytes += is_kept ? size : 0;
    return is_kept;
}
