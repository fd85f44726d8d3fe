/* Takes DOMAIN SECONDS NUMBER and topics with a letter before each: w writes the NUMBER, r reads.
   Prints for each topic what became of it, and the numbers that a reader heard. */
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include "Float64.h"

int main(int n, char **a) {
  dds_entity_t p = dds_create_participant(atoi(a[1]), NULL, NULL);
  dds_entity_t *ends = calloc(n, sizeof *ends);
  unsigned *heard = calloc(n, sizeof *heard);
  dds_qos_t *all = dds_create_qos();
  dds_qset_history(all, DDS_HISTORY_KEEP_ALL, 0);
  std_msgs_msg_dds__Float64_ message = {atoi(a[3])};
  for (int i = 4; i < n; i++) {
    dds_entity_t t = dds_create_topic(p, &std_msgs_msg_dds__Float64__desc, a[i] + 1, NULL, NULL);
    ends[i] = t < 0 ? t : a[i][0] == 'w' ? dds_create_writer(p, t, NULL, NULL)
                                         : dds_create_reader(p, t, all, NULL);
  }
  for (int round = 0; round < atoi(a[2]) * 5; round++, dds_sleepfor(DDS_MSECS(200)))
    for (int i = 4; i < n; i++) {
      void *taken[1] = {NULL};
      dds_sample_info_t info[1];
      if (ends[i] < 0) continue;
      if (a[i][0] == 'w') dds_write(ends[i], &message);
      else while (dds_take(ends[i], taken, info, 1, 1) == 1) {
        if (info[0].valid_data) heard[i] |= 1u << (int)((std_msgs_msg_dds__Float64_ *)taken[0])->data;
        dds_return_loan(ends[i], taken, 1);
      }
    }
  for (int i = 4; i < n; i++) {
    printf("%s %s", a[i], ends[i] == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY ? "refused"
                          : ends[i] < 0 ? "failed" : "allowed");
    for (int number = 0; number < 32; number++)
      if (heard[i] >> number & 1) printf(" %d", number);
    printf("\n");
  }
  return 0;
}
