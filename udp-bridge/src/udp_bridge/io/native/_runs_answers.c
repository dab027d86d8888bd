// SPDX-License-Identifier: Apache-2.0
// What a run answers its sender by itself: credits, and one request for what is missing.
#include "_run.h"

#include <string.h>

// Begin a datagram that answers a part, in memory that is all zero; return where its body goes.
static unsigned char *answer_to(const unsigned char *head, unsigned char *answer, int msg_type,
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

static int is_answered(const struct run *run, const unsigned char *answer, size_t size)
{
    return sendto(run->fd, answer, size, 0, (const struct sockaddr *)&run->sender,
                  sizeof run->sender) == (ssize_t)size;
}

// Acknowledge a part, as `receiving` would; return whether it went out.
int send_credit(struct run *run, const unsigned char *head)
{
    unsigned char credit[HEADER_ROOM + CREDIT_SIZE] = {0};
    unsigned char *body = answer_to(head, credit, CONTROL, run->control_number + run->credits);
    body[1] = head[0];
    body[2] = head[PART_NUMBER];
    memcpy(body + 4, head + SEQ_NUMBER, 4);
    put_u32(body + 8, run->receive_buffer);
    return is_answered(run, credit, body + CREDIT_SIZE - credit);
}

// Ask for the parts before `end` that are missing, as `resend_asking` would, which takes it from
// there. Once in a run, of a message of which nothing was asked for before.
void send_request(struct run *run, int end)
{
    unsigned char request[HEADER_ROOM + REQUEST_SIZE + BITMAP_SIZE] = {0};
    unsigned char *body = answer_to(run->came, request, RESEND, u32(run->came + SEQ_NUMBER));
    int size = ((int)run->arrived.len + 7) / 8, missing = 0;
    body[0] = REQUEST;
    body[1] = run->came[0];
    body[2] = run->came[PARTS_MAX];
    body[3] = 1; // message
    put_u32(body + 4, run->goodput);
    for (int i = 0; i < end; i++) {
        missing += !run->is_in[i];
        body[REQUEST_SIZE + i / 8] |= !run->is_in[i] << i % 8;
    }
    run->due_nanos = 0;
    if (!missing) return; // they only came late
    run->may_ask = 0;
    if (!is_answered(run, request, body + REQUEST_SIZE + size - request)) return;
    memcpy(run->asked, body + REQUEST_SIZE, size);
    run->asked_size = size;
    run->asked_nanos = now_nanos();
    run->due_nanos = run->asked_nanos + LONGEST_NANOS; // then the answer is late
}

// Whether a datagram says that all parts of the message that parts came of have been sent.
int is_offer(const struct run *run, const unsigned char *head, Py_ssize_t size)
{
    unsigned char offer[HEADER_ROOM + OFFER_SIZE], like[HEADER_ROOM + OFFER_SIZE] = {0};
    if (!run->rows_count || run->from.sin_addr.s_addr != run->sender.sin_addr.s_addr ||
        run->from.sin_port != run->sender.sin_port)
        return 0;
    unsigned char *body = answer_to(run->came, like, RESEND, u32(run->came + SEQ_NUMBER));
    body[0] = OFFER;
    body[1] = run->came[0];
    body[2] = run->came[PARTS_MAX];
    if (size != body + OFFER_SIZE - like) return 0;
    gather(run, head, size, (char *)offer);
    return !memcmp(offer, like, body + 3 - like);
}
