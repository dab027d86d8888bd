// SPDX-License-Identifier: Apache-2.0
// The same datagrams without Python: what the machine gives to a plain C program.
//
// `rival receive BUFFER` prints its port, then the time at which each message was whole. `rival send
// BUFFER PORT` reads "SIZE COUNT" from standard input, sends COUNT messages of SIZE bytes one after
// the other, and prints the time at which it began. Up to 16 datagrams for each sendmmsg and one for
// each recvmsg, no sleep within a message, header and slice of the body gathered and scattered in
// place, two bodies in turn as if a user kept one while the next one comes, and the credits of the
// protocol: one at each eighth of the receive buffer and at the end of a message of several parts, at
// most half of the buffer under way, across messages. What it leaves out is all else: checks, loss,
// order, reports, other senders.
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>

enum { PART = 65280, HEADER = 32, MOST = 16700000, OVERHEAD = 1024, BATCH = 16 };
enum { SPIN = 50000 }; // nanoseconds

static unsigned char header[HEADER] = {33, HEADER, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                                       6, 6, '/', 'i', 'm', 'a', 'g', 'e', 'c', 'a', 'm', 'e',
                                       'r', 'a'};
static unsigned char headers[BATCH][HEADER];
static unsigned char *bodies[2];

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

static void report(int64_t number)
{
    printf("%lld\n", (long long)number);
    fflush(stdout);
}

static int bound_socket(int receive_buffer)
{
    struct sockaddr_in any = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int fd = socket(AF_INET, SOCK_DGRAM, 0), half = receive_buffer / 2;
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &half, sizeof half);
    if (bind(fd, (struct sockaddr *)&any, sizeof any)) exit(1);
    return fd;
}

static void receive(int receive_buffer)
{
    int fd = bound_socket(receive_buffer), got = 0, uncredited = 0, turn = 0;
    struct sockaddr_in self, sender;
    socklen_t length = sizeof self;
    unsigned char taken[HEADER], seen[256] = {0};
    uint32_t seq = 0;
    getsockname(fd, (struct sockaddr *)&self, &length);
    report(ntohs(self.sin_port));
    for (int slot = 0;;) {
        unsigned char *body = bodies[turn];
        struct iovec io[2] = {{taken, HEADER}, {body + (size_t)slot * PART, PART}};
        struct msghdr msg = {.msg_name = &sender, .msg_namelen = sizeof sender, .msg_iov = io,
                             .msg_iovlen = 2};
        ssize_t size = -1;
        int64_t until = slot ? now() + SPIN : 0; // a part of the same message comes soon
        while (size < 0 && now() < until) size = recvmsg(fd, &msg, MSG_DONTWAIT);
        if (size < 0) size = recvmsg(fd, &msg, 0);
        if (size < HEADER) return;
        int part = taken[6], parts = taken[7];
        if (memcmp(taken + 2, &seq, 4)) {
            memset(seen, 0, sizeof seen);
            memcpy(&seq, taken + 2, 4);
            got = 0;
        }
        if (part != slot)
            memcpy(body + (size_t)part * PART, body + (size_t)slot * PART, size - HEADER);
        got += !seen[part];
        seen[part] = 1;
        slot = part + 1 < parts ? part + 1 : 0;
        uncredited += size;
        if (parts > 1 && (got == parts || uncredited > receive_buffer / 8)) {
            sendto(fd, taken, HEADER, 0, (struct sockaddr *)&sender, sizeof sender);
            uncredited = 0;
        }
        if (got == parts) {
            report(now());
            turn = !turn;
        }
    }
}

static void send_all(int port, int receive_buffer)
{
    int fd = bound_socket(receive_buffer);
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(port),
                             .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    // Datagrams that need a credit: sent, acknowledged, and sent before each of the last messages.
    int64_t sent = 0, acknowledged = 0, before[256] = {0};
    int64_t window = receive_buffer / 2 / (PART + HEADER + OVERHEAD);
    uint32_t seq = 0;
    char line[64];
    connect(fd, (struct sockaddr *)&to, sizeof to);
    while (fgets(line, sizeof line, stdin)) {
        char *rest_of_line;
        long size = strtol(line, &rest_of_line, 10), count = atol(rest_of_line);
        int parts = size > PART ? (size + PART - 1) / PART : 1;
        int64_t began = now();
        if (size > MOST) exit(2);
        header[7] = parts;
        for (; count; count--) {
            seq++;
            memcpy(header + 2, &seq, 4);
            before[seq & 255] = sent;
            for (int part = 0; part < parts;) {
                struct iovec io[BATCH][2];
                struct mmsghdr batch[BATCH] = {0};
                unsigned char credit[HEADER];
                int is_open = parts == 1 || sent - acknowledged < window, gathered = 0;
                while (recv(fd, credit, HEADER, is_open ? MSG_DONTWAIT : 0) == HEADER) {
                    acknowledged = before[credit[2]] + credit[6] + 1;
                    is_open = sent - acknowledged < window;
                }
                do {
                    long start = (long)part * PART, rest = size - start;
                    memcpy(headers[gathered], header, HEADER);
                    headers[gathered][6] = part++;
                    io[gathered][0] = (struct iovec){headers[gathered], HEADER};
                    io[gathered][1] = (struct iovec){bodies[0] + start, rest < PART ? rest : PART};
                    batch[gathered].msg_hdr = (struct msghdr){.msg_iov = io[gathered], .msg_iovlen = 2};
                    gathered++;
                    sent += parts > 1;
                } while (part < parts && gathered < BATCH && sent - acknowledged < window);
                for (int done = 0; done < gathered;) {
                    int more = sendmmsg(fd, batch + done, gathered - done, 0);
                    if (more < 1) exit(1);
                    done += more;
                }
            }
        }
        report(began);
    }
}

int main(int count, char **words)
{
    if (count < 3) return 2;
    int receive_buffer = atoi(words[2]);
    for (int i = 0; i < 2; i++) memset(bodies[i] = malloc(MOST + PART), 1, MOST + PART);
    if (!strcmp(words[1], "receive")) receive(receive_buffer);
    else if (count > 3) send_all(atoi(words[3]), receive_buffer);
    return 0;
}
