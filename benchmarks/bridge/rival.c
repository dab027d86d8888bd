// SPDX-License-Identifier: Apache-2.0
// The same datagrams without Python: what the machine gives to a plain C program.
//
// `rival receive` prints its port, then the time at which each message was whole. `rival send PORT`
// reads sizes from standard input and prints the time at which it began to send each. One sendmsg or
// recvmsg for each datagram, header and slice of the body gathered and scattered in place, buffers
// reused, and the credits of the protocol: one at each eighth of the receive buffer and at the end,
// at most half of it under way. What it leaves out is all else: checks, loss, order, other senders.
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>

enum { PART = 65280, HEADER = 32, MOST = 16700000, OVERHEAD = 1024 };

static unsigned char header[HEADER] = {33, HEADER, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
                                       0,  0,      6, 6, '/', 'i', 'm', 'a', 'g', 'e', 'c', 'a',
                                       'm', 'e',   'r', 'a'};
static unsigned char *body;

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
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
    int fd = bound_socket(receive_buffer), got = 0, uncredited = 0;
    struct sockaddr_in self, sender;
    socklen_t length = sizeof self;
    unsigned char taken[HEADER], seen[256] = {0};
    uint32_t seq = 0;
    getsockname(fd, (struct sockaddr *)&self, &length);
    printf("%d\n", ntohs(self.sin_port));
    fflush(stdout);
    for (int slot = 0;;) {
        struct iovec io[2] = {{taken, HEADER}, {body + (size_t)slot * PART, PART}};
        struct msghdr msg = {.msg_name = &sender, .msg_namelen = sizeof sender, .msg_iov = io,
                             .msg_iovlen = 2};
        ssize_t size = recvmsg(fd, &msg, 0);
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
        if (got == parts || uncredited > receive_buffer / 8) {
            sendto(fd, taken, HEADER, 0, (struct sockaddr *)&sender, sizeof sender);
            uncredited = 0;
        }
        if (got == parts) {
            printf("%lld\n", (long long)now());
            fflush(stdout);
        }
    }
}

static void send_all(int port, int receive_buffer)
{
    int fd = bound_socket(receive_buffer);
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(port),
                             .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    char line[64];
    connect(fd, (struct sockaddr *)&to, sizeof to);
    for (uint32_t seq = 1; fgets(line, sizeof line, stdin); seq++) {
        long size = atol(line);
        int parts = size > PART ? (size + PART - 1) / PART : 1, acknowledged = 0;
        int window = receive_buffer / 2 / (PART + HEADER + OVERHEAD);
        int64_t began = now();
        memcpy(header + 2, &seq, 4);
        header[7] = parts;
        for (int part = 0; part < parts || acknowledged < parts; ) {
            unsigned char credit[HEADER];
            int is_open = part < parts && part - acknowledged < window;
            while (recv(fd, credit, HEADER, is_open ? MSG_DONTWAIT : 0) == HEADER) {
                if (!memcmp(credit + 2, &seq, 4)) acknowledged = credit[6] + 1;
                is_open = part < parts && part - acknowledged < window;
                if (is_open || acknowledged == parts) break;
            }
            if (!is_open) continue;
            long start = (long)part * PART, rest = size - start;
            struct iovec io[2] = {{header, HEADER}, {body + start, rest < PART ? rest : PART}};
            struct msghdr msg = {.msg_iov = io, .msg_iovlen = 2};
            header[6] = part++;
            if (sendmsg(fd, &msg, 0) < 0) exit(1);
        }
        printf("%lld\n", (long long)began);
        fflush(stdout);
    }
}

int main(int count, char **words)
{
    if (count < 3) return 2;
    int receive_buffer = atoi(words[2]);
    body = malloc(MOST + PART);
    memset(body, 1, MOST + PART);
    if (!strcmp(words[1], "receive")) receive(receive_buffer);
    else if (count > 3) send_all(atoi(words[3]), receive_buffer);
    return 0;
}
