// SPDX-License-Identifier: Apache-2.0
// Batches of parts that are received in one call, without the interpreter.
//
// A Python thread that receives single datagrams needs the interpreter lock for each, and may wait
// 5 ms for it while another thread computes. So predicted parts of a message are received here into
// their slots, acknowledged, and their gaps requested once. Any other datagram ends the batch
// and is returned whole, in order. No state is kept between two calls except the mailbox.
#include "batch_io.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/uio.h>

static int is_from_sender(const struct part_batch *batch)
{
    return batch->source.sin_addr.s_addr == batch->sender.sin_addr.s_addr &&
           batch->source.sin_port == batch->sender.sin_port;
}

// Begin a datagram that answers a part, in zeroed memory; return where its body goes.
static unsigned char *begin_answer(const unsigned char *head, unsigned char *answer, int msg_type,
                                   uint32_t seq_number)
{
    int topic_size = head[TOPIC_SIZE], size = (NAMES + topic_size + 3) & ~3;
    answer[0] = (unsigned char)msg_type;
    answer[1] = (unsigned char)size;
    put_u32(answer + SEQ_NUMBER, seq_number);
    answer[PARTS_MAX] = 1;
    memcpy(answer + TIME, head + TIME, 8);
    answer[TOPIC_SIZE] = head[TOPIC_SIZE];
    memcpy(answer + NAMES, head + NAMES, topic_size);
    return answer + size;
}

static int send_answer(const struct part_batch *batch, const unsigned char *answer, size_t size)
{
    return sendto(batch->fd, answer, size, 0, (const struct sockaddr *)&batch->sender,
                  sizeof batch->sender) == (ssize_t)size;
}

// Acknowledge a part as `inbox.py` would; return whether the Credit was sent, or will be: that of a
// whole message waits for `send_due_credit`, because sending it would delay the message.
static int send_credit(struct part_batch *batch, const unsigned char *head, int waits)
{
    struct due_credit *due = &((struct mailbox *)batch->mailbox.buf)->due;
    memset(due->datagram, 0, sizeof due->datagram);
    unsigned char *body =
        begin_answer(head, due->datagram, CONTROL, batch->control_number + batch->credits);
    body[1] = head[0];
    body[2] = head[PART_NUMBER];
    memcpy(body + 4, head + SEQ_NUMBER, 4);
    put_u32(body + 8, batch->receive_buffer);
    size_t size = body + CREDIT_SIZE - due->datagram;
    if (!waits) return send_answer(batch, due->datagram, size);
    due->to = batch->sender;
    due->size = size;
    return 1;
}

// Send the Credit of the message that the last call completed. Its user has got it by now, and works
// on it: unless more arrives, the Credit waits, because it would wake the sender on another core.
static void send_due_credit(const struct part_batch *batch, int may_wait)
{
    struct due_credit *due = &((struct mailbox *)batch->mailbox.buf)->due;
    struct timespec most = {0, CREDIT_NANOS};
    struct pollfd source = {.fd = batch->fd, .events = POLLIN};
    if (!due->size) return;
    if (may_wait) ppoll(&source, 1, &most, NULL);
    sendto(batch->fd, due->datagram, due->size, MSG_DONTWAIT, (struct sockaddr *)&due->to,
           sizeof due->to);
    due->size = 0;
}

// Request the missing parts before `end`, once, as `nack.py` would, which continues from there.
static void send_request(struct part_batch *batch, int end)
{
    unsigned char request[HEADER_ROOM + REQUEST_SIZE + BITMAP_SIZE] = {0};
    unsigned char *body =
        begin_answer(batch->header, request, RESEND, u32(batch->header + SEQ_NUMBER));
    int size = ((int)batch->arrived.len + 7) / 8, missing = 0;
    body[0] = REQUEST;
    body[1] = batch->header[0];
    body[2] = batch->header[PARTS_MAX];
    body[3] = 1; // messages
    put_u32(body + 4, batch->goodput);
    for (int i = 0; i < end; i++) {
        missing += !batch->has_arrived[i];
        body[REQUEST_SIZE + i / 8] |= !batch->has_arrived[i] << i % 8;
    }
    batch->nack_due_nanos = 0;
    if (!missing) return; // they were only reordered
    batch->may_nack = 0;
    if (!send_answer(batch, request, body + REQUEST_SIZE + size - request)) return;
    memcpy(batch->nack_bitmap, body + REQUEST_SIZE, size);
    batch->nack_bitmap_size = size;
    batch->nack_nanos = now_nanos();
    batch->nack_due_nanos = batch->nack_nanos + MAX_BATCH_NANOS; // time for the answer
}

// Return whether a datagram is the Offer of the batch's message: all its parts were sent.
static int is_offer(const struct part_batch *batch, const unsigned char *head, Py_ssize_t size)
{
    unsigned char offer[HEADER_ROOM + OFFER_SIZE], like[HEADER_ROOM + OFFER_SIZE] = {0};
    if (!batch->ranges_count || !is_from_sender(batch)) return 0;
    unsigned char *body =
        begin_answer(batch->header, like, RESEND, u32(batch->header + SEQ_NUMBER));
    body[0] = OFFER;
    body[1] = batch->header[0];
    body[2] = batch->header[PARTS_MAX];
    if (size != body + OFFER_SIZE - like) return 0;
    copy_datagram(batch, head, size, (char *)offer);
    return !memcmp(offer, like, body + 3 - like);
}

// Receive one datagram: its header apart, its body into the slot of the next part. Return its size.
static Py_ssize_t receive_one(struct part_batch *batch, unsigned char *head, int flags)
{
    int has_slot = batch->missing > 0;
    struct iovec io[3] = {
        {head, has_slot ? batch->predicted.len : 0},
        {slot_of(batch, batch->next), has_slot ? batch->part_size : 0},
        {batch->rest.buf, batch->rest.len},
    };
    _Alignas(struct cmsghdr) char control[64];
    struct msghdr message = {.msg_name = &batch->source, .msg_namelen = sizeof batch->source,
                             .msg_iov = io, .msg_iovlen = 3,
                             .msg_control = control, .msg_controllen = sizeof control};
    Py_ssize_t size = recvmsg(batch->fd, &message, flags);
    batch->error = size < 0 ? errno : 0;
    if (size == 0 && message.msg_namelen == 0) { // the socket was shut
        batch->error = ESHUTDOWN;
        return -1;
    }
    struct cmsghdr *extra = size < 0 ? NULL : CMSG_FIRSTHDR(&message); // only drops are enabled
    if (extra && extra->cmsg_level == SOL_SOCKET && extra->cmsg_type == SO_RXQ_OVFL) {
        uint32_t drops;
        memcpy(&drops, CMSG_DATA(extra), sizeof drops);
        batch->drops = drops;
    }
    return size;
}

// Copy the newest datagram, which lies in three buffers.
void copy_datagram(const struct part_batch *batch, const unsigned char *head, Py_ssize_t size,
                   char *to)
{
    int has_slot = batch->missing > 0;
    Py_ssize_t room[3] = {has_slot ? batch->predicted.len : 0, has_slot ? batch->part_size : 0,
                          size};
    const void *from[3] = {head, slot_of(batch, batch->next), batch->rest.buf};
    for (Py_ssize_t at = 0, i = 0; i < 3; i++) {
        Py_ssize_t some = size - at < room[i] ? size - at : room[i];
        memcpy(to + at, from[i], some);
        at += some;
    }
}

static int continues_range(const struct part_batch *batch, int number)
{
    int last = batch->ranges_count - 1;
    return last >= 0 && number == batch->ranges[last].first + batch->ranges[last].count;
}

// Return whether a datagram is a missing part, as `ReceiveSlots.matches`. seq_number and time of a
// new message are free, and it must begin with its first part.
static int is_predicted(const struct part_batch *batch, const unsigned char *head, Py_ssize_t size)
{
    int number = head[PART_NUMBER], header_size = (int)batch->predicted.len;
    Py_ssize_t body = size - header_size;
    if (!batch->missing || body <= 0 || body > batch->part_size) return 0;
    if (number >= batch->arrived.len || batch->has_arrived[number]) return 0;
    if (!is_from_sender(batch)) return 0;
    int is_begun = batch->is_open || batch->ranges_count;
    if (number != batch->next && !is_begun) return 0;
    if (batch->ranges_count == MAX_ARRIVAL_RANGES && !continues_range(batch, number)) return 0;
    const unsigned char *wanted = batch->ranges_count ? batch->header : batch->predicted.buf;
    return head[PARTS_MAX] == wanted[PARTS_MAX] &&
           (body == batch->part_size || number == wanted[PARTS_MAX] - 1) &&
           !memcmp(head, wanted, SEQ_NUMBER) &&
           !memcmp(head + TOPIC_SIZE, wanted + TOPIC_SIZE, header_size - TOPIC_SIZE) &&
           (is_begun ? !memcmp(head + SEQ_NUMBER, wanted + SEQ_NUMBER, 4) &&
                           !memcmp(head + TIME, wanted + TIME, 8)
                     : u32(head + TIME_NSEC) < NANOS);
}

static int is_gap_before(const struct part_batch *batch, int number)
{
    while (number && batch->has_arrived[number - 1]) number--;
    return number > 0;
}

// Record a part, move it into its slot, and acknowledge it if due; return false if that failed.
static int take_part(struct part_batch *batch, const unsigned char *head, Py_ssize_t size)
{
    int number = head[PART_NUMBER], last = (int)batch->arrived.len - 1;
    if (!batch->ranges_count) memcpy(batch->header, head, batch->predicted.len);
    if (number != batch->next) {
        memcpy(slot_of(batch, number), slot_of(batch, batch->next), size - batch->predicted.len);
        int64_t due_nanos = now_nanos() + batch->debounce_nanos;
        int is_sooner = !batch->nack_due_nanos || due_nanos < batch->nack_due_nanos;
        if (batch->debounce_nanos && is_sooner && is_gap_before(batch, number))
            batch->nack_due_nanos = due_nanos;
    }
    if (!continues_range(batch, number)) {
        batch->ranges[batch->ranges_count].first = number;
        batch->ranges[batch->ranges_count++].count = 0;
    }
    batch->ranges[batch->ranges_count - 1].count++;
    batch->has_arrived[number] = 1;
    batch->missing--;
    if (number > batch->next) batch->next = number; // not back to a resent part
    while (batch->missing && batch->has_arrived[batch->next])
        batch->next = batch->next < last ? batch->next + 1 : 0;
    if (number == last) batch->last_size = size - batch->predicted.len;
    batch->uncredited += size;
    int is_due = batch->uncredited > batch->receive_buffer / CREDIT_SHARE;
    if (batch->missing && number != last && !is_due) return 1;
    if (!send_credit(batch, head, !batch->missing && !is_due)) return 0; // it is still due
    batch->uncredited = 0;
    batch->credits++;
    return 1;
}

// Receive a part without sleeping, if one comes soon. To sleep and to be woken takes both ends longer
// than to send and to receive a part. Waits in vain are limited: the sender may be on another host,
// or need this core.
static Py_ssize_t receive_soon(struct part_batch *batch, unsigned char *head, int64_t most_nanos)
{
    int64_t began_nanos = now_nanos(), waited_nanos = 0;
    if (most_nanos > batch->spin_nanos) most_nanos = batch->spin_nanos;
    while (waited_nanos < most_nanos) {
        Py_ssize_t size = receive_one(batch, head, MSG_DONTWAIT);
        if (size >= 0 || batch->error != EAGAIN) return size;
        waited_nanos = now_nanos() - began_nanos;
    }
    batch->spin_nanos -= waited_nanos;
    batch->error = EAGAIN;
    return -1;
}

// Receive one datagram; wait for it until a Request is due.
static Py_ssize_t receive_next(struct part_batch *batch, unsigned char *head)
{
    for (;;) {
        int waits = !batch->ranges_count || !batch->nack_due_nanos;
        int64_t left = waits ? NANOS : batch->nack_due_nanos - now_nanos();
        if (left <= 0) {
            if (!batch->may_nack) return -1;
            int end = (int)batch->arrived.len;
            while (!batch->has_arrived[end - 1]) end--;
            send_request(batch, end);
            continue;
        }
        if (batch->ranges_count) {
            Py_ssize_t size = receive_soon(batch, head, left < SPIN_NANOS ? left : SPIN_NANOS);
            if (size >= 0 || batch->error != EAGAIN) return size;
        }
        Py_ssize_t size = receive_one(batch, head, waits ? 0 : MSG_DONTWAIT);
        if (size >= 0 || waits || batch->error != EAGAIN) return size;
        struct timespec most = {left / NANOS, left % NANOS};
        struct pollfd source = {.fd = batch->fd, .events = POLLIN};
        ppoll(&source, 1, &most, NULL);
    }
}

// Receive until an unpredicted datagram arrives. Return its size; -1 if none did.
static Py_ssize_t receive_parts(struct part_batch *batch, unsigned char *head, int is_flowing)
{
    int64_t until_nanos = 0;
    Py_ssize_t size = -1;
    // Releasing the interpreter lock may cost milliseconds, so first take what is there already.
    if (is_flowing) size = receive_one(batch, head, MSG_DONTWAIT);
    if (size < 0 && (!is_flowing || batch->error == EAGAIN)) {
        batch->thread = PyEval_SaveThread();
        send_due_credit(batch, 1);
        size = receive_one(batch, head, 0);
    } else {
        send_due_credit(batch, 0);
    }
    while (size >= 0) {
        int is_part = is_predicted(batch, head, size);
        if (!is_part && !keep_credit(batch, head, size)) {
            if (batch->may_nack && is_offer(batch, head, size))
                send_request(batch, (int)batch->arrived.len);
            break;
        }
        if (!batch->thread) batch->thread = PyEval_SaveThread();
        int is_over =
            is_part ? !take_part(batch, head, size) || !batch->missing : batch->is_delegated_done;
        size = -1;
        if (is_over) break;
        if (!until_nanos) until_nanos = now_nanos() + MAX_BATCH_NANOS;
        else if (now_nanos() > until_nanos) break;
        size = receive_next(batch, head);
    }
    if (batch->thread) PyEval_RestoreThread(batch->thread);
    return size;
}

static PyObject *ranges_of(const struct part_batch *batch)
{
    PyObject *ranges = PyTuple_New(batch->ranges_count);
    for (int i = 0; ranges && i < batch->ranges_count; i++) {
        PyObject *row = Py_BuildValue("ii", batch->ranges[i].first, batch->ranges[i].count);
        if (row) PyTuple_SET_ITEM(ranges, i, row);
        else Py_CLEAR(ranges);
    }
    return ranges;
}

// Check that the slots lie in the block; return false, with an exception, if they do not.
static int check_slots(struct part_batch *batch)
{
    const unsigned char *head = batch->predicted.buf, *arrived = batch->arrived.buf;
    Py_ssize_t count = batch->arrived.len;
    int is_right = batch->rest.len >= 65536 && batch->predicted.len < HEADER_ROOM &&
                   count <= MAX_PARTS &&
                   (!count || (batch->predicted.len >= HEADER_MIN && batch->part_size > 0 &&
                               batch->part_size <= batch->block.len &&
                               count * batch->part_size <= batch->block.len &&
                               NAMES + head[TOPIC_SIZE] <= batch->predicted.len &&
                               head[PARTS_MAX] >= 2));
    for (Py_ssize_t i = 0; is_right && i < count; i++) {
        batch->has_arrived[i] = arrived[i];
        batch->missing += !arrived[i];
    }
    if (!batch->missing) batch->next = 0;
    else is_right &= 0 <= batch->next && batch->next < count && !arrived[batch->next];
    if (!is_right) PyErr_SetString(PyExc_ValueError, "the parts do not lie in the block");
    return is_right;
}

// receive(fd, rest, *ReceiveSlots, *CreditState, is_flowing, memory of a mailbox, *SmallTopics)
// -> None, or (PartBatch or WholeMessage or SmallMessage, errno, drops)
PyObject *receive(PyObject *self, PyObject *args)
{
    struct part_batch batch = {.drops = -1, .spin_nanos = MAX_SPIN_NANOS};
    struct small_topics small;
    PyObject *upcoming;
    int port, is_flowing;
    const char *host;
    (void)self;
    if (!PyArg_ParseTuple(args, "iw*w*y*(si)niy*pLLpOKIIIpw*O!O!OO", &batch.fd, &batch.rest,
                          &batch.block, &batch.predicted, &host, &port, &batch.part_size,
                          &batch.next, &batch.arrived, &batch.is_open, &batch.nack_due_nanos,
                          &batch.debounce_nanos, &batch.may_nack, &upcoming, &batch.uncredited,
                          &batch.receive_buffer, &batch.control_number, &batch.goodput,
                          &is_flowing, &batch.mailbox, &PyDict_Type, &small.table,
                          &PyList_Type, &small.delivered, &small.message_type,
                          &small.record_type))
        return NULL;
    PyObject *found = NULL, *unmatched = NULL, *sender = NULL, *ranges = NULL;
    unsigned char head[HEADER_ROOM];
    if (!check_slots(&batch) || !mailbox_in(&batch.mailbox) || !are_small_topics(&small) ||
        !to_address(host, port, &batch.sender))
        goto end;
    batch.last_size = batch.part_size;
    Py_ssize_t size = receive_parts(&batch, head, is_flowing);
    if (size < 0 && !batch.ranges_count && !batch.kept) {
        Py_INCREF(Py_None);
        found = Py_None;
        goto end;
    }
    if (size >= 0) {
        char name[INET_ADDRSTRLEN] = "";
        inet_ntop(AF_INET, &batch.source.sin_addr, name, sizeof name);
        unmatched = PyBytes_FromStringAndSize(NULL, size);
        if (unmatched) copy_datagram(&batch, head, size, PyBytes_AS_STRING(unmatched));
        sender = Py_BuildValue("si", name, ntohs(batch.source.sin_port));
        if (!unmatched || !sender) goto end;
        if (!batch.ranges_count && !batch.kept) {
            PyObject *message = take_small(unmatched, sender, &small);
            if (message) found = Py_BuildValue("(NO)iL", message, sender, 0, batch.drops);
            if (message || PyErr_Occurred()) goto end;
        }
    }
    if (size < 0 && !batch.missing && upcoming != Py_None) {
        PyObject *whole = take_whole(&batch, upcoming, &small);
        if (whole) found = Py_BuildValue("NiL", whole, 0, batch.drops);
        if (whole || PyErr_Occurred()) goto end;
    }
    ranges = ranges_of(&batch);
    if (!ranges) goto end;
    found = Py_BuildValue("(y#OniKOOsiKiy#L)iL", batch.header,
                          batch.ranges_count ? batch.predicted.len : 0, ranges, batch.last_size,
                          batch.credits, batch.uncredited, unmatched ? unmatched : Py_None,
                          sender ? sender : Py_None, "", batch.kept, batch.kept_bytes,
                          batch.is_delegated_done, batch.nack_bitmap,
                          (Py_ssize_t)batch.nack_bitmap_size, batch.nack_nanos, batch.error,
                          batch.drops);
end:
    Py_XDECREF(ranges);
    Py_XDECREF(unmatched);
    Py_XDECREF(sender);
    PyBuffer_Release(&batch.rest);
    PyBuffer_Release(&batch.block);
    PyBuffer_Release(&batch.predicted);
    PyBuffer_Release(&batch.arrived);
    PyBuffer_Release(&batch.mailbox);
    return found;
}
