// SPDX-License-Identifier: Apache-2.0
// Runs of datagrams from and to a socket in one call each, without the interpreter.
//
// A Python thread that asks for each datagram gets the interpreter each time, up to 5 ms late where
// another thread computes. So parts of a message that are exactly those expected are received here
// one after the other, each into its place, acknowledged, and their gaps asked for once; all else
// is handed back at once, whole and in order, and `receiving` judges it by every rule. Nothing is
// kept between two calls, but for credits: while a sender finds room for more, those for what it
// sends are kept here until it looks (`credit_mailbox.py`), and wake nobody. Where it finds none it may
// leave the rest of a message here, and the thread that receives a credit sends what that makes
// room for.
#include "_run.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/uio.h>

// Receive one datagram: header apart, body into the place of the next part. Return its size.
static Py_ssize_t receive_one(struct run *run, unsigned char *head, int flags)
{
    int is_placed = run->missing > 0;
    struct iovec io[3] = {
        {head, is_placed ? run->head.len : 0},
        {place_of(run, run->next), is_placed ? run->part_size : 0},
        {run->rest.buf, run->rest.len},
    };
    _Alignas(struct cmsghdr) char control[64];
    struct msghdr message = {.msg_name = &run->from, .msg_namelen = sizeof run->from,
                             .msg_iov = io, .msg_iovlen = 3,
                             .msg_control = control, .msg_controllen = sizeof control};
    Py_ssize_t size = recvmsg(run->fd, &message, flags);
    run->error = size < 0 ? errno : 0;
    if (size == 0 && message.msg_namelen == 0) { // so does the kernel tell that it was shut
        run->error = ESHUTDOWN;
        return -1;
    }
    struct cmsghdr *told = size < 0 ? NULL : CMSG_FIRSTHDR(&message); // nothing else is asked for
    if (told && told->cmsg_level == SOL_SOCKET && told->cmsg_type == SO_RXQ_OVFL) {
        uint32_t drops;
        memcpy(&drops, CMSG_DATA(told), sizeof drops);
        run->drops = drops;
    }
    return size;
}

// Copy a datagram that lies in three places.
void gather(const struct run *run, const unsigned char *head, Py_ssize_t size, char *to)
{
    int is_placed = run->missing > 0;
    Py_ssize_t room[3] = {is_placed ? run->head.len : 0, is_placed ? run->part_size : 0, size};
    const void *from[3] = {
        head, place_of(run, run->next), run->rest.buf};
    for (Py_ssize_t at = 0, i = 0; i < 3; i++) {
        Py_ssize_t some = size - at < room[i] ? size - at : room[i];
        memcpy(to + at, from[i], some);
        at += some;
    }
}

static int is_next_in_row(const struct run *run, int number)
{
    int last = run->rows_count - 1;
    return last >= 0 && number == run->rows[last].first + run->rows[last].count;
}

// Whether a datagram is a part that is missing. Of a message of which nothing was taken before, seq_number
// and time are its own, and the first part comes first; `receiving` has seen all else of the header in
// another message.
static int is_expected(const struct run *run, const unsigned char *head, Py_ssize_t size)
{
    int number = head[PART_NUMBER], header_size = (int)run->head.len;
    Py_ssize_t body = size - header_size;
    if (!run->missing || body <= 0 || body > run->part_size) return 0;
    if (number >= run->arrived.len || run->is_in[number]) return 0;
    if (run->from.sin_addr.s_addr != run->sender.sin_addr.s_addr ||
        run->from.sin_port != run->sender.sin_port)
        return 0;
    int is_begun = run->is_open || run->rows_count;
    if (number != run->next && !is_begun) return 0;
    if (run->rows_count == ROWS && !is_next_in_row(run, number)) return 0;
    const unsigned char *wanted = run->rows_count ? run->came : run->head.buf;
    return head[PARTS_MAX] == wanted[PARTS_MAX] &&
           (body == run->part_size || number == wanted[PARTS_MAX] - 1) &&
           !memcmp(head, wanted, SEQ_NUMBER) &&
           !memcmp(head + TOPIC_SIZE, wanted + TOPIC_SIZE, header_size - TOPIC_SIZE) &&
           (is_begun ? !memcmp(head + SEQ_NUMBER, wanted + SEQ_NUMBER, 4) &&
                           !memcmp(head + TIME, wanted + TIME, 8)
                     : u32(head + TIME_NSEC) < NANOS);
}

static int is_gap_before(const struct run *run, int number)
{
    while (number && run->is_in[number - 1]) number--;
    return number > 0;
}

// Take note of a part, put it where it belongs, and acknowledge it if that is due; return whether
// that went well.
static int take_part(struct run *run, const unsigned char *head, Py_ssize_t size)
{
    int number = head[PART_NUMBER], last = (int)run->arrived.len - 1;
    if (!run->rows_count) memcpy(run->came, head, run->head.len);
    if (number != run->next) {
        memcpy(place_of(run, number), place_of(run, run->next), size - run->head.len);
        int64_t due_nanos = now_nanos() + run->patience_nanos;
        int is_sooner = !run->due_nanos || due_nanos < run->due_nanos;
        if (run->patience_nanos && is_sooner && is_gap_before(run, number))
            run->due_nanos = due_nanos;
    }
    if (!is_next_in_row(run, number)) {
        run->rows[run->rows_count].first = number;
        run->rows[run->rows_count++].count = 0;
    }
    run->rows[run->rows_count - 1].count++;
    run->is_in[number] = 1;
    run->missing--;
    if (number > run->next) run->next = number; // behind one sent again it goes on where it was
    while (run->missing && run->is_in[run->next]) run->next = run->next < last ? run->next + 1 : 0;
    if (number == last) run->last_size = size - run->head.len;
    run->uncredited += size;
    if (run->missing && number != last && run->uncredited <= run->receive_buffer / CREDIT_SHARE)
        return 1;
    if (!send_credit(run, head)) return 0; // then it is still due
    run->uncredited = 0;
    run->credits++;
    return 1;
}

// Receive one datagram, which is waited for as long as nothing else is due.
static Py_ssize_t receive_next(struct run *run, unsigned char *head)
{
    for (;;) {
        int waits = !run->rows_count || !run->due_nanos;
        int64_t left = waits ? 0 : run->due_nanos - now_nanos();
        if (!waits && left <= 0) {
            if (!run->may_ask) return -1;
            int end = (int)run->arrived.len;
            while (!run->is_in[end - 1]) end--;
            send_request(run, end);
            continue;
        }
        Py_ssize_t size = receive_one(run, head, waits ? 0 : MSG_DONTWAIT);
        if (size >= 0 || waits || run->error != EAGAIN) return size;
        struct timespec most = {left / NANOS, left % NANOS};
        struct pollfd source = {.fd = run->fd, .events = POLLIN};
        ppoll(&source, 1, &most, NULL);
    }
}

// Receive until something comes that is not expected. Return its size; -1 where nothing did.
static Py_ssize_t receive_parts(struct run *run, unsigned char *head, int is_flowing)
{
    int64_t until_nanos = 0;
    Py_ssize_t size = -1;
    // What lies there is taken without giving the interpreter away, for that may cost milliseconds.
    if (is_flowing) size = receive_one(run, head, MSG_DONTWAIT);
    if (size < 0 && (!is_flowing || run->error == EAGAIN)) {
        run->thread = PyEval_SaveThread();
        size = receive_one(run, head, 0);
    }
    while (size >= 0) {
        int is_part = is_expected(run, head, size);
        if (!is_part && !keep_credit(run, head, size)) {
            if (run->may_ask && is_offer(run, head, size))
                send_request(run, (int)run->arrived.len);
            break;
        }
        if (!run->thread) run->thread = PyEval_SaveThread();
        int is_over =
            is_part ? !take_part(run, head, size) || !run->missing : run->is_over;
        size = -1;
        if (is_over) break;
        if (!until_nanos) until_nanos = now_nanos() + LONGEST_NANOS;
        else if (now_nanos() > until_nanos) break;
        size = receive_next(run, head);
    }
    if (run->thread) PyEval_RestoreThread(run->thread);
    return size;
}

static PyObject *rows_of(const struct run *run)
{
    PyObject *rows = PyTuple_New(run->rows_count);
    for (int i = 0; rows && i < run->rows_count; i++) {
        PyObject *row = Py_BuildValue("ii", run->rows[i].first, run->rows[i].count);
        if (row) PyTuple_SET_ITEM(rows, i, row);
        else Py_CLEAR(rows);
    }
    return rows;
}

// Whether what is expected lies in its block; an exception says so where it does not.
static int is_sound(struct run *run)
{
    const unsigned char *head = run->head.buf, *arrived = run->arrived.buf;
    Py_ssize_t count = run->arrived.len;
    int is_right = run->rest.len >= 65536 && run->head.len < HEADER_ROOM && count <= MOST_PARTS &&
                   (!count || (run->head.len >= HEADER_MIN && run->part_size > 0 &&
                               run->part_size <= run->block.len &&
                               count * run->part_size <= run->block.len &&
                               NAMES + head[TOPIC_SIZE] <= run->head.len && head[PARTS_MAX] >= 2));
    for (Py_ssize_t i = 0; is_right && i < count; i++) {
        run->is_in[i] = arrived[i];
        run->missing += !arrived[i];
    }
    if (run->missing) is_right &= 0 <= run->next && run->next < count && !arrived[run->next];
    else run->next = 0;
    if (!is_right) PyErr_SetString(PyExc_ValueError, "the parts do not lie in the block");
    return is_right;
}

// receive(fd, rest, block, header, (host, port), part size, next, which are in, is open, due,
// patience, may ask, uncredited, receive buffer, control number, goodput, is flowing, memory for
// credits) -> None, or (header, ((first, count), ...), last size, credits, uncredited, stray datagram
// or None, its sender, why it is refused, credits kept, their bytes, whether an order is over, bitmap
// of what was asked for, when), errno, drops
PyObject *receive(PyObject *self, PyObject *args)
{
    struct run run = {.drops = -1};
    int port, is_flowing;
    const char *host;
    (void)self;
    if (!PyArg_ParseTuple(args, "iw*w*y*(si)niy*pLLpKIIIpw*", &run.fd, &run.rest, &run.block,
                          &run.head, &host, &port, &run.part_size, &run.next, &run.arrived,
                          &run.is_open, &run.due_nanos, &run.patience_nanos, &run.may_ask,
                          &run.uncredited, &run.receive_buffer, &run.control_number, &run.goodput,
                          &is_flowing, &run.parking))
        return NULL;
    PyObject *found = NULL, *stray = NULL, *sender = NULL, *rows = NULL;
    unsigned char head[HEADER_ROOM];
    if (!is_sound(&run) || !parking_in(&run.parking) || !to_address(host, port, &run.sender))
        goto end;
    run.last_size = run.part_size;
    Py_ssize_t size = receive_parts(&run, head, is_flowing);
    if (size < 0 && !run.rows_count && !run.parked) {
        Py_INCREF(Py_None);
        found = Py_None;
        goto end;
    }
    rows = rows_of(&run);
    if (!rows) goto end;
    if (size >= 0) {
        char name[INET_ADDRSTRLEN] = "";
        inet_ntop(AF_INET, &run.from.sin_addr, name, sizeof name);
        stray = PyBytes_FromStringAndSize(NULL, size);
        if (stray) gather(&run, head, size, PyBytes_AS_STRING(stray));
        sender = Py_BuildValue("si", name, ntohs(run.from.sin_port));
        if (!stray || !sender) goto end;
    }
    found = Py_BuildValue("(y#OniKOOsiKiy#L)iL", run.came, run.rows_count ? run.head.len : 0, rows,
                          run.last_size, run.credits, run.uncredited, stray ? stray : Py_None,
                          sender ? sender : Py_None, "", run.parked, run.parked_bytes, run.is_over,
                          run.asked, (Py_ssize_t)run.asked_size, run.asked_nanos, run.error,
                          run.drops);
end:
    Py_XDECREF(rows);
    Py_XDECREF(stray);
    Py_XDECREF(sender);
    PyBuffer_Release(&run.rest);
    PyBuffer_Release(&run.block);
    PyBuffer_Release(&run.head);
    PyBuffer_Release(&run.arrived);
    PyBuffer_Release(&run.parking);
    return found;
}
