/* Dense products in place of libxsmm, which PyFR's OpenMP backend asks for: the functions that it calls, in doubles. */
#include <stdlib.h>
#include <string.h>

typedef struct
{
    int rows, columns, inner, in_stride, out_stride;
    double beta, *matrix;
} Product;

void libxsmm_init(void) {}
void libxsmm_finalize(void) {}
unsigned long long libxsmm_timer_tick(void) { return 0; }

void *libxsmm_fsspmdm_create(int type, int m, int n, int k, int lda, int ldb, int ldc, const double *alpha,
                             const double *beta, const double *a, int streams, void *tick)
{
    Product *product = malloc(sizeof *product);
    *product = (Product){m, n, k, ldb, ldc, *beta, malloc(sizeof(double) * m * k)};
    for (int i = 0; i < m; ++i)
        for (int j = 0; j < k; ++j)
            product->matrix[i * k + j] = *alpha * a[i * lda + j];
    return product;
}

void libxsmm_fsspmdm_execute(const Product *product, const double *in, double *out)
{
    for (int i = 0; i < product->rows; ++i)
    {
        double *row = out + (size_t)i * product->out_stride;
        if (product->beta == 0)
            memset(row, 0, sizeof(double) * product->columns);
        for (int j = 0; j < product->inner; ++j)
        {
            const double entry = product->matrix[i * product->inner + j];
            const double *from = in + (size_t)j * product->in_stride;
            for (int l = 0; l < product->columns; ++l)
                row[l] += entry * from[l];
        }
    }
}

void libxsmm_fsspmdm_destroy(Product *product)
{
    free(product->matrix);
    free(product);
}
